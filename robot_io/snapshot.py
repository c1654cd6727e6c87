"""One consistent reading of all sensors of one tick."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from operator import attrgetter
from typing import Any

import numpy as np

from surefoot.schemas.arrays import Array, Vec3, Vec6
from surefoot.schemas.messages import SCHEMA_VERSION, Message
from surefoot.schemas.sensors import SENSORS, SNAPSHOT_FIELDS, Sensor
from surefoot.schemas.topics import TICK_SENSORS

Ages = tuple[int, ...]
"""Ticks since each sensor's message, in the order of the sensor table."""
OTHER_CLOCK_NS = 200_000_000
"""Readings of one tick whose stamps are farther apart are of several clocks, and their
ages are not known: no loop balances with readings so old [ns]."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Sensors of one tick, as the robot reports them; arrays are not to be written.

    Its fields, after tick and stamp, are those of the sensor table, in that order.

    Attributes:
        tick: the robot's counter.
        stamp_ns: the robot's monotonic clock [ns].
        q: (n_a,) measured joint positions [rad].
        dq: (n_a,) measured joint velocities [rad/s].
        effort: (n_a,) servo torques [N m].
        quat_xyzw: (4,) attitude the unit itself reports, world from IMU.
        angular_velocity: (3,) gyroscope, IMU frame [rad/s].
        linear_acceleration: (3,) specific force, IMU frame [m/s^2].
        ft_left: (6,) [force; moment] from below on the left ankle, sensor frame.
        ft_right: (6,) the same for the right ankle.
        measured_ns: when each sensor measured what it reports, by the robot's clock and
            in the order of the sensor table [ns]; empty: all did at ``stamp_ns``, or it
            is not known. Of a message that did not come, only the age in ticks is told:
            see :data:`Ages`.
    """

    tick: int
    stamp_ns: int
    q: Array
    dq: Array
    effort: Array
    quat_xyzw: Array
    angular_velocity: Vec3
    linear_acceleration: Vec3
    ft_left: Vec6
    ft_right: Vec6
    measured_ns: tuple[int, ...] = ()

    @property
    def latencies_ns(self) -> tuple[int, ...]:
        """How long ago each sensor measured, in the order of the sensor table [ns]."""
        if not self.measured_ns:
            return _NO_LATENCIES
        return tuple([self.stamp_ns - then for then in self.measured_ns])


_NO_LATENCIES = (0,) * len(SENSORS)
readings: Callable[[Snapshot], tuple[Array, ...]] = attrgetter(*SNAPSHOT_FIELDS)
"""All readings of a snapshot, in the order of the sensor table."""


class SnapshotLayout:
    """All numbers of a tick in one block of memory: which is where.

    Attributes:
        size: how many numbers there are.
        places: where each field stands, by name, in the order of the sensor table.
    """

    def __init__(self, joint_count: int) -> None:
        """Lay out a block."""
        sizes = dict.fromkeys(SNAPSHOT_FIELDS, 0)
        for entry in SENSORS:
            for quantity in entry.quantities:
                sizes[quantity.field] += quantity.size or joint_count
        ends = accumulate(sizes.values())
        self.places = {
            field: slice(end - size, end)
            for (field, size), end in zip(sizes.items(), ends, strict=True)
        }
        self.size = sum(sizes.values())
        self._slices = list(self.places.values())
        self._floats = struct.Struct(f"{self.size}d")

    def place(self, entry: Sensor, attribute: str) -> slice:
        """Find the numbers of one attribute of a sensor's message."""
        field, part = entry.place(attribute)
        block = self.places[field]
        return slice(
            block.start + part.start,
            block.stop if part.stop is None else block.start + part.stop,
        )

    def join(self, tick: int, messages: Sequence[Message]) -> Snapshot:
        """Join the newest message of each sensor.

        Args:
            tick: of the snapshot; single messages may be older.
            messages: of all sensors, in the order of the sensor table.
        """
        numbers = np.empty(self.size)
        self._floats.pack_into(numbers.data, 0, *_numbers_of(*messages))
        stamp_ns, measured_ns = _stamps(
            [m.stamp_ns if m.tick == tick else None for m in messages]
        )
        if stamp_ns is None:
            stamp_ns = max([message.stamp_ns for message in messages])
        return self.view(tick, stamp_ns, numbers, measured_ns=measured_ns)

    def view(
        self,
        tick: int,
        stamp_ns: int,
        numbers: Array,
        *,
        measured_ns: tuple[int, ...] = (),
    ) -> Snapshot:
        """Make a snapshot of a block of numbers; it sees the block, not a copy.

        Args:
            tick: the robot's counter.
            stamp_ns: the robot's monotonic clock [ns].
            numbers: (size,) all readings.
            measured_ns: see :class:`Snapshot`.
        """
        parts: list[Any] = [numbers[part] for part in self._slices]
        parts.append(measured_ns)
        return Snapshot(tick, stamp_ns, *parts)


def ages_of(messages: Sequence[Message], tick: int) -> Ages:
    """How many ticks each message is behind a tick."""
    return tuple([tick - message.tick for message in messages])


def sensor_messages(snapshot: Snapshot, *, stamp_ns: int) -> tuple[Message, ...]:
    """Take a snapshot apart, one message per sensor.

    Args:
        snapshot: sensors of one tick.
        stamp_ns: the robot's monotonic clock at that tick [ns].

    Returns:
        Messages in the order of the sensor table, each stamped when it was measured.
    """
    return _messages_of(
        snapshot, [stamp_ns - latency for latency in snapshot.latencies_ns]
    )


def _write_joining() -> str:
    """An expression: all numbers of the messages of a tick, one after the other."""
    parts = [
        f"*m{index}.{name}"
        for index, entry in enumerate(SENSORS)
        for name in entry.attributes
    ]
    arguments = ", ".join(f"m{index}" for index in range(len(SENSORS)))
    return f"lambda {arguments}: ({', '.join(parts)},)"


def _write_splitting() -> str:
    """An expression: the messages of a snapshot."""
    calls = []
    for index, entry in enumerate(SENSORS):
        values = []
        listed: set[str] = set()
        for name in entry.attributes:
            field, part = entry.place(name)
            numbers = field if field in listed else f"({field} := s.{field}.tolist())"
            listed.add(field)
            cut = "" if part.stop is None else f"[{part.start}:{part.stop}]"
            values.append(f"{name}={numbers}{cut}")
        head = f"schema={SCHEMA_VERSION}, tick=s.tick, stamp_ns=stamps[{index}]"
        calls.append(f"kind{index}({head}, {', '.join(values)})")
    return f"lambda s, stamps: ({', '.join(calls)},)"


# Written out from the table once, as dataclasses do it: loops over it take twice as
# long, a thousand times a second.
_numbers_of: Callable[..., tuple[float, ...]] = eval(_write_joining())
_messages_of: Callable[[Snapshot, list[int]], tuple[Message, ...]] = eval(
    _write_splitting(),
    {f"kind{index}": entry.message for index, entry in enumerate(SENSORS)},
)


def _stamps(stamps: list[int | None]) -> tuple[int | None, tuple[int, ...]]:
    """Stamp of a snapshot, and when its readings were measured.

    Returns:
        The newest stamp, None without any; and all, or nothing where they are the same.
    """
    known = [stamp for stamp in stamps if stamp is not None]
    if not known:
        return None, ()
    newest = max(known)
    apart_ns = newest - min(known)
    if apart_ns == 0 or apart_ns > OTHER_CLOCK_NS:
        return newest, ()
    return newest, tuple([newest if stamp is None else stamp for stamp in stamps])


class Delivery:
    """Joins readings as the client does: a missing one keeps its last value."""

    def __init__(self) -> None:
        """Nothing has come yet."""
        self._last: Snapshot | None = None
        self._ticks = dict.fromkeys(TICK_SENSORS, 0)

    def deliver(
        self, snapshot: Snapshot, missing: tuple[str, ...]
    ) -> tuple[Snapshot, Ages]:
        """What the controller gets.

        Args:
            snapshot: as the robot took it.
            missing: channels whose message does not come, or cannot be read.

        Returns:
            The snapshot to use, and the age of each channel in ticks.
        """
        tick = snapshot.tick
        old: dict[str, Any] = {}
        for entry in SENSORS:
            if entry.name in missing and self._last is not None:
                old.update((f, getattr(self._last, f)) for f in entry.fields)
            else:
                self._ticks[entry.name] = tick
        if snapshot.measured_ns:
            came = [entry.name not in missing for entry in SENSORS]
            stamps = zip(snapshot.measured_ns, came, strict=True)
            stamp_ns, measured = _stamps(
                [s if has_come else None for s, has_come in stamps]
            )
            old |= {"stamp_ns": stamp_ns or snapshot.stamp_ns, "measured_ns": measured}
        self._last = replace(snapshot, **old) if old else snapshot
        return self._last, tuple([tick - then for then in self._ticks.values()])
