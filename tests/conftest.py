"""Fixtures of all tests: a bus of their own, the command, a short scenario."""

from __future__ import annotations

import signal
from functools import partial
from pathlib import Path

import pytest

from surefoot.schemas.endpoints import Endpoints
from tests.command import Surefoot, run_surefoot
from tests.support import free_port


@pytest.fixture
def endpoints() -> Endpoints:
    """Both ends of a bus on this host, apart from every other test's."""
    locator = f"tcp/127.0.0.1:{free_port()}"
    return Endpoints(listen=[locator], connect=[locator])


@pytest.fixture
def surefoot(tmp_path: Path) -> Surefoot:
    """Run a command of ``surefoot`` in an empty folder."""
    work = tmp_path / "work"
    work.mkdir()
    return partial(run_surefoot, cwd=work)


@pytest.fixture
def short_scenario(tmp_path: Path) -> Path:
    """Standing on firm ground for a fraction of a second."""
    path = tmp_path / "short.toml"
    path.write_text(
        'name = "short"\nduration_s = 0.3\n[sensors]\nforce_noise_n = 2.0\n'
    )
    return path


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
