"""How a command behaves as a child of ``surefoot run``."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable

READY_LINE = "ready"
_PROGRESS_PERIOD_S = 0.25


def begin_as_child() -> None:
    """Ends this process in order (SIGTERM to itself) once its stdin closes."""

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()


def progress_reporter() -> Callable[[int], None]:
    """Makes a function that writes the tick to stdout, four times a second at most."""
    due = 0.0

    def report(tick: int) -> None:
        nonlocal due
        now = time.monotonic()
        if now >= due:
            due = now + _PROGRESS_PERIOD_S
            print(tick, flush=True)

    return report


def report_ready() -> None:
    """Tells the parent that this process can do its part now."""
    print(READY_LINE, flush=True)
