"""Ends waits on the bus, since Zenoh's ``recv`` takes no time limit."""

from __future__ import annotations

import math
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

TOKEN_BYTES = 16
"""Shorter than any message, so that one comparison of lengths tells them apart."""


class Waker:
    """Puts a token on the key that the main thread waits on, once the wait is over.

    Blocking in ``recv`` costs one wake-up per message; anything with a time limit in
    Python would cost a second one, of a Python thread. So a guard thread looks every
    few milliseconds whether a wait has outlived its deadline, which the loop that
    gets its messages in time never notices.

    Attributes:
        token: what ends a wait; not a message. Drawn at random, so that no peer can
            send it.
        was_nudged: whether the last wait that ended was broken off by a nudge.
    """

    def __init__(self, session: zenoh.Session, *, granularity_s: float) -> None:
        """Prepares the guard; :meth:`running` starts it.

        Args:
            session: where the waits are.
            granularity_s: how late a wait may end [s].
        """
        self.token = secrets.token_bytes(TOKEN_BYTES)
        self._session = session
        self._granularity_s = granularity_s
        self._key = ""
        self._deadline = math.inf
        self._nudged = False
        self.was_nudged = False
        self._stop = threading.Event()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Runs the guard thread."""
        thread = threading.Thread(target=self._watch, name="bus-waker", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._stop.set()
            thread.join()

    def watch(self, key: str, deadline: float) -> None:
        """Says that a wait begins.

        Args:
            key: what is waited on.
            deadline: when it ends, on ``time.monotonic`` [s].
        """
        self._key = key
        self._deadline = deadline

    def unwatch(self) -> None:
        """Says that the wait is over."""
        self._deadline = math.inf

    def nudge(self) -> None:
        """Ends the wait under way, or the next one; callable from any thread."""
        self._nudged = True

    def is_over(self) -> bool:
        """Whether the wait under way has ended; takes back a nudge."""
        self.was_nudged = self._nudged
        if self._nudged:
            self._nudged = False
            return True
        return time.monotonic() >= self._deadline

    def _watch(self) -> None:
        while not self._stop.wait(self._granularity_s):
            waiting = not math.isinf(self._deadline)
            if waiting and (self._nudged or time.monotonic() >= self._deadline):
                self._session.put(
                    self._key,
                    self.token,
                    allowed_destination=zenoh.Locality.SESSION_LOCAL,
                )
