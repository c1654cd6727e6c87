"""Fixtures of all tests that meet on a bus."""

from __future__ import annotations

import signal

import pytest

from surefoot.schemas.endpoints import Endpoints
from tests.support import free_port


@pytest.fixture
def endpoints() -> Endpoints:
    """Both ends of a bus on this host, apart from every other test's."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    return Endpoints(listen=[locator], connect=[locator])


def pytest_configure() -> None:
    """Ctrl-C reaches the processes under test, whoever started the tests.

    A shell starts background jobs with SIGINT ignored, and every child inherits that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What is left out is said, lest it be taken for tested."""
    left_out = [
        item
        for item in terminalreporter.stats.get("deselected", [])
        if item.get_closest_marker("slow") is not None
    ]
    if left_out:
        terminalreporter.write_line(
            f"{len(left_out)} slow tests left out; run them with: pytest -m slow"
        )
