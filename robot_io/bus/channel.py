"""Receives one key of the bus, as payloads or as checked messages in order."""

from __future__ import annotations

import logging
import math
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

import msgspec
import zenoh
from zenoh.handlers import RingChannel

from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import Message

_LOG = logging.getLogger(__name__)

TOKEN_BYTES = 16
"""Shorter than any message, so that the length alone identifies a token."""
NEVER = -1


class Waker:
    """Ends a wait by putting a token on the key that the main thread waits on.

    Blocking in ``recv`` costs one wake-up per message. A time limit in Python would
    cost a second one, of a Python thread. So a guard thread checks every few
    milliseconds whether a wait has outlived its deadline. A loop that gets its messages
    in time never notices it.

    Attributes:
        token: payload that ends a wait; not a message. It is random, so that no peer
            can send it.
        was_interrupted: whether an interrupt ended the last wait.
    """

    def __init__(self, session: zenoh.Session, *, granularity_s: float) -> None:
        """Prepare the guard; :meth:`running` starts it.

        Args:
            session: session of the waits.
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
        """Report that a wait begins.

        Args:
            key: key that is waited on.
            deadline: end of the wait, on ``time.monotonic`` [s].
        """
        self._key = key
        self._deadline = deadline

    def unwatch(self) -> None:
        """Report that the wait is over."""
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
    """Payloads of one key, in order of arrival.

    A ring in Zenoh keeps the newest payloads until the calling thread takes them. No
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
            waker: ends the waits.
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
            deadline: end of the wait, on ``time.monotonic`` [s].

        Returns:
            The payload; None when the deadline has passed or an interrupt came.
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
        """Drop all payloads received so far."""
        while self._try_receive() is not None:
            pass

    def _is_token(self, payload: bytes) -> bool:
        return len(payload) == TOKEN_BYTES and payload == self._waker.token


M = TypeVar("M", bound=Message)
T = TypeVar("T", bound=msgspec.Struct)


class MessageReader(Generic[T]):
    """Base of the readers of a channel: checks messages and counts unreadable ones.

    It logs the reason for the first unreadable message. Otherwise a user who misses
    the message would look for a silent sender.

    Attributes:
        malformed: messages that could not be read.
    """

    def __init__(
        self, channel: Channel, kind: type[T], *, joint_count: int | None = None
    ) -> None:
        """Read from a channel."""
        self.malformed = 0
        self._channel = channel
        self._kind = kind
        self._joint_count = joint_count

    def _decode(self, data: bytes) -> T | None:
        """Return the message, or None when it cannot be read."""
        try:
            return decode(data, self._kind, joint_count=self._joint_count)
        except MessageError as error:
            if not self.malformed:
                _LOG.warning("a message cannot be read and is passed over: %s", error)
            self.malformed += 1
            return None


class Inbox(MessageReader[M]):
    """Reads a channel message by message.

    Unreadable messages are counted and skipped. So are messages that come twice, or
    after a message of a later tick.

    Attributes:
        outdated: messages that came twice or too late.
    """

    def __init__(
        self, channel: Channel, kind: type[M], *, joint_count: int | None = None
    ) -> None:
        """Read from a channel; see :class:`MessageReader`."""
        super().__init__(channel, kind, joint_count=joint_count)
        self.outdated = 0
        self._head: M | None = None
        self._last_tick = NEVER

    def peek(self) -> M | None:
        """Return the next message without taking it; None if there is none yet."""
        while self._head is None:
            data = self._channel.poll()
            if data is None:
                return None
            self._head = self._read(data)
        return self._head

    def peek_wait(self, deadline: float) -> M | None:
        """Wait for the next message and return it, without taking it.

        Args:
            deadline: end of the wait, on ``time.monotonic`` [s].

        Returns:
            The message; None when the deadline has passed or an interrupt came.
        """
        while self._head is None:
            data = self._channel.wait(deadline)
            if data is None:
                return None
            self._head = self._read(data)
        return self._head

    @property
    def was_interrupted(self) -> bool:
        """Whether the last wait that gave None was broken off before its deadline."""
        return self._channel.was_interrupted

    def drop(self) -> None:
        """Move on to the next message."""
        if self._head is not None:
            self._last_tick = self._head.tick
            self._head = None

    def restart(self) -> None:
        """Drop all messages received so far; ticks may begin anew."""
        self._channel.discard()
        self._head = None
        self._last_tick = NEVER

    def _read(self, data: bytes) -> M | None:
        message = self._decode(data)
        if message is not None and message.tick <= self._last_tick:
            self.outdated += 1
            return None
        return message


class Latest(MessageReader[T]):
    """Keeps the newest valid message of a channel."""

    def __init__(
        self, channel: Channel, kind: type[T], *, joint_count: int | None = None
    ) -> None:
        """Read from a channel; see :class:`MessageReader`."""
        super().__init__(channel, kind, joint_count=joint_count)
        self._message: T | None = None

    def poll(self) -> T | None:
        """Return the newest message so far, the same object until a newer one comes."""
        while (data := self._channel.poll()) is not None:
            message = self._decode(data)
            if message is not None:
                self._message = message
        return self._message

    def forget(self) -> None:
        """Drop all messages received so far."""
        self._channel.discard()
        self._message = None
