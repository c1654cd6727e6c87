"""Receives one key of the bus on the calling thread."""

from __future__ import annotations

import zenoh
from zenoh.handlers import RingChannel

from robot_io.waker import TOKEN_BYTES, Waker


class Channel:
    """Payloads of one key, in the order they came.

    A ring in Zenoh keeps the newest ones until the calling thread takes them: no
    Python callback runs, the sender is never held up, and closing never hangs. Not
    thread-safe.
    """

    def __init__(
        self, session: zenoh.Session, key: str, *, waker: Waker, depth: int
    ) -> None:
        """Subscribes.

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
        """The next payload, or None when there is none yet."""
        while True:
            sample = self._try_receive()
            if sample is None:
                return None
            payload = sample.payload.to_bytes()
            if not self._is_token(payload):
                return payload

    def wait(self, deadline: float) -> bytes | None:
        """The next payload; waits for it.

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
    def was_nudged(self) -> bool:
        """Whether the last wait that gave None was broken off before its deadline."""
        return self._waker.was_nudged

    def discard(self) -> None:
        """Forgets what has come so far."""
        while self._try_receive() is not None:
            pass

    def _is_token(self, payload: bytes) -> bool:
        return len(payload) == TOKEN_BYTES and payload == self._waker.token
