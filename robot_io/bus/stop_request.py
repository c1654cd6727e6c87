"""Asks a running node to end in good order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """A request to end, from a signal or from another thread.

    The first signal asks for an orderly end, the second for one at once. A third one
    is not caught any more: the system ends the process.

    Attributes:
        is_set: whether it was asked for.
        is_urgent: whether it was asked for again.
        cause: name of the signal, or what else asked.
    """

    def __init__(self) -> None:
        """Start without a request."""
        self.is_set = False
        self.is_urgent = False
        self.cause = ""
        self._wake: Callable[[], None] | None = None

    def set(self, cause: str = "asked to stop") -> None:
        """Request the end; only sets flags, so a signal handler may call it."""
        self.cause = self.cause or cause
        self.is_set = True
        if self._wake is not None:
            self._wake()

    def waking(self, wake: Callable[[], None]) -> None:
        """Have a wait ended when somebody asks.

        Args:
            wake: sets a flag at most; called from signal handlers.
        """
        self._wake = wake
        if self.is_set:
            wake()

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Turn SIGINT and SIGTERM into requests; only the main thread gets any."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.getsignal(number) for number in SIGNALS}
        for number in SIGNALS:
            signal.signal(number, self._on_signal)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.is_set:
            self.is_urgent = True
            for caught in SIGNALS:
                signal.signal(caught, signal.SIG_DFL)
        self.set(signal.Signals(number).name)
