"""Fixtures of all tests that meet on a bus."""

from __future__ import annotations

import signal

import pytest

from schemas.endpoints import Endpoints
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
