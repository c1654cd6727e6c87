"""What the stabilizer got of the recorded sensors."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import msgspec

from surefoot.playback.timeline import Entry
from surefoot.recording.read import decode_json, with_nan
from surefoot.robot_io.snapshot import Ages, Snapshot, SnapshotLayout, ages_of
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import Message
from surefoot.schemas.topics import TICK_SENSORS, topic

_NULL = b"null"


def to_wire(data: bytes, *, is_raw: bool) -> bytes:
    """Return the MessagePack bytes of a message.

    JSON knows no NaN and no infinity: a reading that was either is null in the record
    and NaN again afterwards. All other numbers come back bit for bit.

    Args:
        data: as recorded.
        is_raw: whether these are the bytes of the bus already.

    Raises:
        MessageError: the record holds no message there.
    """
    if is_raw:
        return data
    message = decode_json(data)
    if _NULL in data:
        message = {name: with_nan(value) for name, value in message.items()}
    try:
        return msgspec.msgpack.encode(message)
    except (OverflowError, ValueError, RecursionError) as error:
        raise MessageError(f"not a message of the bus: {error}") from error


class Reading(NamedTuple):
    """A snapshot, and ticks since each sensor's message."""

    snapshot: Snapshot
    ages: Ages


class RecordedSensors:
    """Joins recorded messages by the rules of the bus.

    A message that cannot be read counts as one that did not come, and a sensor
    without a message for a tick keeps its last values.
    """

    def __init__(
        self, entries: Iterable[Entry], *, joint_count: int, raw: dict[str, bool]
    ) -> None:
        """Begin before the first tick.

        Args:
            entries: in order; those of other channels are passed over.
            joint_count: n_a.
            raw: by channel, whether it holds the bytes of the bus.
        """
        self._raw, self._joint_count = raw, joint_count
        self._layout = SnapshotLayout(joint_count)
        self._entries: dict[str, list[Entry]] = {name: [] for name in TICK_SENSORS}
        for entry in entries:
            if entry.channel in self._entries:
                self._entries[entry.channel].append(entry)
        self._next = dict.fromkeys(TICK_SENSORS, 0)
        self._latest: dict[str, Any] = dict.fromkeys(TICK_SENSORS)

    def at(self, tick: int) -> Reading | None:
        """Return the stabilizer's reading of a tick; ticks must not decrease.

        Returns:
            None while there is a sensor nothing has come from.
        """
        for name in TICK_SENSORS:
            self._advance(name, tick)
        messages = [m for m in self._latest.values() if m is not None]
        if len(messages) < len(TICK_SENSORS):
            return None
        return Reading(self._layout.join(tick, messages), ages_of(messages, tick))

    def _advance(self, name: str, tick: int) -> None:
        """Take the messages of a sensor up to a tick."""
        entries = self._entries[name]
        while self._next[name] < len(entries):
            entry = entries[self._next[name]]
            if entry.tick > tick:
                return
            self._next[name] += 1
            message = self._read(name, entry)
            before = self._latest[name]
            if message is not None and (before is None or message.tick > before.tick):
                self._latest[name] = message

    def _read(self, name: str, entry: Entry) -> Message | None:
        kind: type[Any] = topic(name).message
        try:
            message: Message = decode(
                to_wire(entry.data, is_raw=self._raw[name]),
                kind,
                joint_count=self._joint_count,
            )
        except MessageError:
            return None
        return message
