"""One consistent reading of all sensors of one tick.

The server splits snapshots into messages for the bus; the client joins them again.
"""

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
"""Ages of the sensors' messages [ticks], in the order of the sensor table."""
MOST_PASSED = 20
"""Longest train of ticks without an answer that is taken in. An inbox keeps more, so a
record tells which they were."""
OTHER_CLOCK_NS = 200_000_000
"""Largest distance between stamps of one tick from one clock [ns]. Stamps farther apart
come from several clocks and tell no ages; no loop balances with such old readings."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Sensors of one tick, as the robot reports them; do not write to the arrays.

    The fields after tick and stamp are those of the sensor table, in its order.

    Attributes:
        tick: the robot's tick counter.
        stamp_ns: the robot's monotonic clock [ns].
        q: (n_a,) measured joint positions [rad].
        dq: (n_a,) measured joint velocities [rad/s].
        effort: (n_a,) servo torques [N m].
        quat_xyzw: (4,) attitude reported by the IMU itself, world from IMU.
        angular_velocity: (3,) gyroscope, IMU frame [rad/s].
        linear_acceleration: (3,) specific force, IMU frame [m/s^2].
        ft_left: (6,) [force; moment] from below on the left ankle, sensor frame.
        ft_right: (6,) the same for the right ankle.
        measured_ns: time of each sensor's measurement on the robot's clock, in the
            order of the sensor table [ns]. Empty: all at ``stamp_ns``, or unknown. A
            message that did not come has only an age in ticks, see :data:`Ages`.
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
        """Time since each sensor's measurement [ns], in the sensor table's order."""
        if not self.measured_ns:
            return _NO_LATENCIES
        return tuple([self.stamp_ns - then for then in self.measured_ns])


_NO_LATENCIES = (0,) * len(SENSORS)
readings: Callable[[Snapshot], tuple[Array, ...]] = attrgetter(*SNAPSHOT_FIELDS)
"""All readings of a snapshot, in the order of the sensor table."""


class SnapshotLayout:
    """Layout of all numbers of a tick in one block of memory.

    Attributes:
        size: number of numbers.
        places: slice of each field, by name, in the order of the sensor table.
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
        """Return the slice of one attribute of a sensor's message."""
        field, part = entry.place(attribute)
        block = self.places[field]
        return slice(
            block.start + part.start,
            block.stop if part.stop is None else block.start + part.stop,
        )

    def join(self, tick: int, messages: Sequence[Message]) -> Snapshot:
        """Join the newest message of each sensor.

        Args:
            tick: tick of the snapshot; single messages may be older.
            messages: one of each sensor, in the order of the sensor table.
        """
        numbers = np.empty(self.size)
        self._floats.pack_into(numbers.data, 0, *_numbers_of(*messages))
        stamp_ns, measured_ns = _stamps(
            [m.stamp_ns if m.tick == tick else None for m in messages]
        )
        if stamp_ns is None:
            stamp_ns = max([message.stamp_ns for message in messages])
        return self.view(tick, stamp_ns, numbers, measured_ns=measured_ns)

    def join_passed(
        self, passed: Sequence[Sequence[Message]], *, after: int, before: int
    ) -> tuple[Snapshot, ...]:
        """Join the ticks between two answered ones, as far as they are complete.

        Args:
            passed: messages of each sensor, in the order of the sensor table.
            after: the tick answered last.
            before: the tick to be answered now.

        Returns:
            Snapshots in the order of their ticks; only ticks of which every sensor has
            sent its message, and only the last :data:`MOST_PASSED` ones.
        """
        after = max(after, before - 1 - MOST_PASSED)
        by_tick = [{message.tick: message for message in said} for said in passed]
        ticks = set(by_tick[0]).intersection(*by_tick[1:])
        return tuple(
            self.join(tick, [said[tick] for said in by_tick])
            for tick in sorted(ticks)
            if after < tick < before
        )

    def view(
        self,
        tick: int,
        stamp_ns: int,
        numbers: Array,
        *,
        measured_ns: tuple[int, ...] = (),
    ) -> Snapshot:
        """Return a snapshot of a block of numbers; its arrays are views of the block.

        Args:
            tick: the robot's tick counter.
            stamp_ns: the robot's monotonic clock [ns].
            numbers: (size,) all readings.
            measured_ns: see :class:`Snapshot`.
        """
        parts: list[Any] = [numbers[part] for part in self._slices]
        parts.append(measured_ns)
        return Snapshot(tick, stamp_ns, *parts)


def ages_of(messages: Sequence[Message], tick: int) -> Ages:
    """Return how many ticks each message is behind a tick."""
    return tuple([tick - message.tick for message in messages])


def sensor_messages(snapshot: Snapshot, *, stamp_ns: int) -> tuple[Message, ...]:
    """Split a snapshot into one message per sensor.

    Args:
        snapshot: sensors of one tick.
        stamp_ns: the robot's monotonic clock at that tick [ns].

    Returns:
        Messages in the order of the sensor table, each stamped at its measurement.
    """
    return _messages_of(
        snapshot, [stamp_ns - latency for latency in snapshot.latencies_ns]
    )


def _write_joining() -> str:
    """Return an expression for all numbers of a tick's messages, in order."""
    parts = [
        f"*m{index}.{name}"
        for index, entry in enumerate(SENSORS)
        for name in entry.attributes
    ]
    arguments = ", ".join(f"m{index}" for index in range(len(SENSORS)))
    return f"lambda {arguments}: ({', '.join(parts)},)"


def _write_splitting() -> str:
    """Return an expression for the messages of a snapshot."""
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


# Written out from the table once, as dataclasses do: loops over it would take twice as
# long, a thousand times a second.
_numbers_of: Callable[..., tuple[float, ...]] = eval(_write_joining())
_messages_of: Callable[[Snapshot, list[int]], tuple[Message, ...]] = eval(
    _write_splitting(),
    {f"kind{index}": entry.message for index, entry in enumerate(SENSORS)},
)


def _stamps(stamps: list[int | None]) -> tuple[int | None, tuple[int, ...]]:
    """Return the stamp of a snapshot and the measurement times of its readings.

    Returns:
        The newest stamp, None without any; and all stamps, empty if all are the same or
        of several clocks.
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
    """Joins readings as the client does: a missing reading keeps its last value."""

    def __init__(self) -> None:
        """Begin without any reading."""
        self._last: Snapshot | None = None
        self._ticks = dict.fromkeys(TICK_SENSORS, 0)

    def deliver(
        self, snapshot: Snapshot, missing: tuple[str, ...]
    ) -> tuple[Snapshot, Ages]:
        """Return the reading that the controller receives.

        Args:
            snapshot: the robot's reading.
            missing: channels whose message does not come or cannot be read.

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
