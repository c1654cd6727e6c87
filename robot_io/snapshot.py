"""One consistent reading of all sensors of one tick."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any

import numpy as np

from surefoot.schemas.arrays import Array, Vec3, Vec6
from surefoot.schemas.messages import SCHEMA_VERSION, ForceTorque, ImuState, JointState
from surefoot.schemas.topics import TICK_SENSORS

FIELDS = {
    "joints": ("q", "dq", "effort"),
    "imu": ("quat_xyzw", "angular_velocity", "linear_acceleration"),
    "left_ankle_ft": ("ft_left",),
    "right_ankle_ft": ("ft_right",),
}
"""What of a snapshot each channel carries."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Sensors of one tick, as the robot reports them; arrays are not to be written.

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


class SnapshotLayout:
    """Puts all numbers of a tick into one block of memory, and names its parts."""

    def __init__(self, joint_count: int) -> None:
        """Lay out a block.

        Args:
            joint_count: n_a.
        """
        sizes = (joint_count, joint_count, joint_count, 4, 3, 3, 6, 6)
        ends = list(accumulate(sizes))
        self._slices = [
            slice(end - size, end) for size, end in zip(sizes, ends, strict=True)
        ]
        self._size = ends[-1]
        self._floats = struct.Struct(f"{self._size}d")

    def join(
        self,
        tick: int,
        joints: JointState,
        imu: ImuState,
        left: ForceTorque,
        right: ForceTorque,
    ) -> Snapshot:
        """Join the newest message of each sensor.

        Args:
            tick: of the snapshot; single messages may be older.
            joints: joint positions, velocities and efforts.
            imu: inertial unit.
            left: left ankle force-torque.
            right: right ankle force-torque.
        """
        numbers = np.empty(self._size)
        self._floats.pack_into(  # half the time of np.array
            numbers.data,
            0,
            *joints.q,
            *joints.dq,
            *joints.effort,
            *imu.quat_xyzw,
            *imu.angular_velocity,
            *imu.linear_acceleration,
            *left.force,
            *left.moment,
            *right.force,
            *right.moment,
        )
        return Snapshot(tick, joints.stamp_ns, *(numbers[s] for s in self._slices))


def sensor_messages(
    snapshot: Snapshot, *, stamp_ns: int
) -> tuple[JointState, ImuState, ForceTorque, ForceTorque]:
    """Take a snapshot apart, one message per sensor.

    Args:
        snapshot: sensors of one tick.
        stamp_ns: the robot's monotonic clock when they were taken [ns].

    Returns:
        Messages in the order of ``TICK_SENSORS``.
    """
    tick = snapshot.tick
    left, right = snapshot.ft_left.tolist(), snapshot.ft_right.tolist()
    return (
        JointState(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            q=snapshot.q.tolist(),
            dq=snapshot.dq.tolist(),
            effort=snapshot.effort.tolist(),
        ),
        ImuState(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            quat_xyzw=snapshot.quat_xyzw.tolist(),
            angular_velocity=snapshot.angular_velocity.tolist(),
            linear_acceleration=snapshot.linear_acceleration.tolist(),
        ),
        ForceTorque(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            force=left[:3],
            moment=left[3:],
        ),
        ForceTorque(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            force=right[:3],
            moment=right[3:],
        ),
    )


class Delivery:
    """Joins readings as the client does: a missing one keeps its last value."""

    def __init__(self) -> None:
        """Nothing has come yet."""
        self._last: Snapshot | None = None
        self._ticks = dict.fromkeys(TICK_SENSORS, 0)

    def deliver(
        self, snapshot: Snapshot, missing: tuple[str, ...]
    ) -> tuple[Snapshot, tuple[int, int, int, int]]:
        """What the controller gets.

        Args:
            snapshot: as the robot took it.
            missing: channels whose message does not come, or cannot be read.

        Returns:
            The snapshot to use, and the age of each channel in ticks.
        """
        tick = snapshot.tick
        old: dict[str, Any] = {}
        for name in TICK_SENSORS:
            if name in missing and self._last is not None:
                old.update((f, getattr(self._last, f)) for f in FIELDS[name])
            else:
                self._ticks[name] = tick
        self._last = replace(snapshot, **old) if old else snapshot
        joints, imu, left, right = (tick - self._ticks[name] for name in TICK_SENSORS)
        return self._last, (joints, imu, left, right)
