"""Sensors of a relayed robot on the controller's side, in simulated time.

Joins messages as the client's assembler does, without a bus: the last sensor to be
sent says that a tick is there, one that is late is waited for, one that stays away is
given up.
"""

from __future__ import annotations

from typing import Any, Generic

from surefoot.robot_io.bus.channel import NEVER, M
from surefoot.robot_io.client_side.assembler import SnapshotReading
from surefoot.robot_io.client_side.client import PATIENCE_S
from surefoot.robot_io.relay.forwarder import Schedule
from surefoot.robot_io.relay.lane import Parcel
from surefoot.robot_io.snapshot import SnapshotLayout, ages_of
from surefoot.schemas.codec import decode
from surefoot.schemas.errors import MessageError
from surefoot.schemas.sensors import SENSORS

INSTANT_S = 1e-9
"""A message due at the very instant has come, whatever its last bit says."""


class HeardSensor(Generic[M]):
    """Messages of one sensor on their way, and those that have come.

    Attributes:
        latest: newest message taken; None before the first.
        is_lost: it kept the others waiting, and is not waited for until it is back.
    """

    def __init__(self, kind: type[M], *, joint_count: int) -> None:
        """Nothing has come.

        Args:
            kind: its messages.
            joint_count: n_a.
        """
        self.latest: M | None = None
        self.is_lost = False
        self._kind = kind
        self._joint_count = joint_count
        self._coming: Schedule[bytes] = Schedule()
        self._waiting: list[M] = []
        self._newest = NEVER

    @property
    def tick(self) -> int:
        """Tick of the newest message taken."""
        return NEVER if self.latest is None else self.latest.tick

    @property
    def newest(self) -> int:
        """Tick of the newest message that has come."""
        return self._newest

    def send(self, parcel: Parcel) -> None:
        """Put a message on its way."""
        self._coming.put(parcel.data, at_s=parcel.at_s)

    def hear(self, now_s: float) -> None:
        """Read what has come; what is unreadable, old or twice is left out."""
        while (data := self._coming.take_due(now_s + INSTANT_S)) is not None:
            try:
                message = decode(data, self._kind, joint_count=self._joint_count)
            except MessageError:
                continue
            if message.tick > self._newest:
                self._newest = message.tick
                self._waiting.append(message)

    def take_up_to(self, tick: int) -> None:
        """Take messages up to one of a tick; the last of them counts."""
        while self._waiting and self._waiting[0].tick <= tick:
            self.latest = self._waiting.pop(0)


class DelayedSensors:
    """All sensors of a robot, joined into snapshots; the newest tick wins."""

    def __init__(self, *, joint_count: int) -> None:
        """Nothing has come.

        Args:
            joint_count: n_a.
        """
        self.sensors: dict[str, HeardSensor[Any]] = {
            entry.name: HeardSensor(entry.message, joint_count=joint_count)
            for entry in SENSORS
        }
        self._layout = SnapshotLayout(joint_count)
        self._answered = NEVER
        self._since_s = 0.0
        self._is_waiting = False

    def next(self, now_s: float) -> SnapshotReading | None:
        """Return the snapshot to answer now; None while there is none.

        Args:
            now_s: the time, never going back [s].
        """
        for sensor in self.sensors.values():
            sensor.hear(now_s)
        if max(sensor.newest for sensor in self.sensors.values()) <= self._answered:
            return None
        if not self._is_waiting:
            self._is_waiting, self._since_s = True, now_s
        is_over = now_s - self._since_s >= PATIENCE_S - INSTANT_S
        *_, last = (s for s in self.sensors.values() if not s.is_lost or is_over)
        tick = last.newest if not is_over else self._newest_tick()
        if tick <= self._answered:
            return None
        late = [s for s in self.sensors.values() if s.newest < tick]
        if any(not s.is_lost for s in late) and not is_over:
            return None
        for sensor in self.sensors.values():
            sensor.is_lost = sensor in late
            sensor.take_up_to(tick)
        self._answered, self._is_waiting = tick, False
        messages = [s.latest for s in self.sensors.values() if s.latest is not None]
        if len(messages) < len(self.sensors):
            return None
        stale = tuple(name for name, s in self.sensors.items() if s.tick != tick)
        snapshot = self._layout.join(tick, messages)
        return SnapshotReading(snapshot, stale, ages_of(messages, tick), 0)

    def _newest_tick(self) -> int:
        return max(sensor.newest for sensor in self.sensors.values())
