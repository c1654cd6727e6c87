"""How the messages of a tick become one snapshot."""

from __future__ import annotations

import struct
from itertools import accumulate

import numpy as np

from robot_io.snapshot import Snapshot
from schemas.messages import ForceTorque, ImuState, JointState


class SnapshotLayout:
    """Puts all numbers of a tick into one block of memory, and names its parts."""

    def __init__(self, joint_count: int) -> None:
        """Lays out a block.

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
        """Joins the newest message of each sensor.

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
