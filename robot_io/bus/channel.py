"""Receives one key of the bus on the calling thread."""

from __future__ import annotations

import math
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh
from zenoh.handlers import RingChannel

TOKEN_BYTES = 16
"""Shorter than any message, so that the length alone identifies a token."""


class Waker:
    """Puts a token on the key that the main thread waits on, once the wait is over.

    Blocking in ``recv`` costs one wake-up per message; anything with a time limit in
    Python would cost a second one, of a Python thread. So a guard thread looks every
    few milliseconds whether a wait has outlived its deadline, which the loop that
    gets its messages in time never notices.

    Attributes:
        token: what ends a wait; not a message. Drawn at random, so that no peer can
            send it.
        was_interrupted: whether the last wait that ended was broken off by a interrupt.
    """

    def __init__(self, session: zenoh.Session, *, granularity_s: float) -> None:
        """Prepare the guard; :meth:`running` starts it.

        Args:
            session: where the waits are.
            granularity_s: how late a wait may end [s].
        """
        self.token = secrets.token_bytes(TOKEN_BYTES)
        self._session = session
        self._granularity_s = granularity_s
        self._key = ""
        self._deadline = math.inf
        self._interrupted = False
        self.was_interrupted = False
        self._stop = threading.Event()

    @contextmanager
    def running(self) -> Iterator[None]:
        """Run the guard thread."""
        thread = threading.Thread(target=self._watch, name="bus-waker", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._stop.set()
            thread.join()

    def watch(self, key: str, deadline: float) -> None:
        """Say that a wait begins.

        Args:
            key: what is waited on.
            deadline: when it ends, on ``time.monotonic`` [s].
        """
        self._key = key
        self._deadline = deadline

    def unwatch(self) -> None:
        """Say that the wait is over."""
        self._deadline = math.inf

    def interrupt(self) -> None:
        """End the wait under way, or the next one; callable from any thread."""
        self._interrupted = True

    def is_over(self) -> bool:
        """Return whether the current wait has ended; clears an interrupt."""
        self.was_interrupted = self._interrupted
        if self._interrupted:
            self._interrupted = False
            return True
        return time.monotonic() >= self._deadline

    def _watch(self) -> None:
        while not self._stop.wait(self._granularity_s):
            waiting = not math.isinf(self._deadline)
            if waiting and (self._interrupted or time.monotonic() >= self._deadline):
                self._session.put(
                    self._key,
                    self.token,
                    allowed_destination=zenoh.Locality.SESSION_LOCAL,
                )


class Channel:
    """Payloads of one key, in the order they came.

    A ring in Zenoh keeps the newest ones until the calling thread takes them: no
    Python callback runs, the sender is never held up, and closing never hangs. Not
    thread-safe.
    """

    def __init__(
        self, session: zenoh.Session, key: str, *, waker: Waker, depth: int
    ) -> None:
        """Subscribe.

        Args:
            session: an open session.
            key: relative to the session's namespace.
            waker: ends waits.
            depth: payloads kept; the oldest is dropped for a new one.
        """
        self._key = key
        self._waker = waker
        self._subscriber = session.declare_subscriber(key, RingChannel(depth))
        self._receive = self._subscriber.handler.recv
        self._try_receive = self._subscriber.handler.try_recv

    def poll(self) -> bytes | None:
        """Return the next payload, or None when there is none yet."""
        while True:
            sample = self._try_receive()
            if sample is None:
                return None
            payload = sample.payload.to_bytes()
            if not self._is_token(payload):
                return payload

    def wait(self, deadline: float) -> bytes | None:
        """Wait for the next payload and return it.

        Args:
            deadline: until when, on ``time.monotonic`` [s].

        Returns:
            None when the deadline has passed or the waker was nudged.
        """
        payload = self.poll()
        if payload is not None:
            return payload
        self._waker.watch(self._key, deadline)
        try:
            while True:
                payload = self._receive().payload.to_bytes()
                if not self._is_token(payload):
                    return payload
                if self._waker.is_over():
                    return None
        finally:
            self._waker.unwatch()

    @property
    def was_interrupted(self) -> bool:
        """Whether the last wait that gave None was broken off before its deadline."""
        return self._waker.was_interrupted

    def discard(self) -> None:
        """Forget what has come so far."""
        while self._try_receive() is not None:
            pass

    def _is_token(self, payload: bytes) -> bool:
        return len(payload) == TOKEN_BYTES and payload == self._waker.token
