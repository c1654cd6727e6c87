"""Does things at their time, on a thread of its own."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from robot_io.relay.schedule import Schedule

Deed = Callable[[], None]
_LOG = logging.getLogger(__name__)


class Dispatcher:
    """A thread that sleeps until the next thing is due.

    Attributes:
        error: what ended it, if anything did.
    """

    def __init__(self) -> None:
        """Prepares; :meth:`running` starts the thread."""
        self.error: Exception | None = None
        self._schedule: Schedule[Deed] = Schedule()
        self._changed = threading.Condition()
        self._is_over = False

    @contextmanager
    def running(self) -> Iterator[None]:
        """Runs the thread; what is not yet due at the end is left undone."""
        thread = threading.Thread(target=self._run, name="relay", daemon=True)
        thread.start()
        try:
            yield
        finally:
            with self._changed:
                self._is_over = True
                self._changed.notify()
            thread.join()

    def do(self, deed: Deed, *, at_s: float) -> None:
        """Has something done, at a time on ``time.monotonic`` [s]."""
        with self._changed:
            self._schedule.put(deed, at_s=at_s)
            self._changed.notify()

    def do_last(self, deed: Deed) -> None:
        """Has something done after all that is to be done already."""
        with self._changed:
            self._schedule.put_last(deed, now_s=time.monotonic())
            self._changed.notify()

    def _run(self) -> None:
        try:
            while (deed := self._next()) is not None:
                deed()
        except Exception as error:
            self.error = error  # told, and raised, by the main thread
            _LOG.error("the relay cannot go on: %s", error)

    def _next(self) -> Deed | None:
        """Waits for the next thing that is due; None at the end."""
        with self._changed:
            while not self._is_over:
                now_s = time.monotonic()
                deed = self._schedule.take_due(now_s)
                if deed is not None:
                    return deed
                next_s = self._schedule.next_s
                self._changed.wait(None if next_s is None else next_s - now_s)
        return None
