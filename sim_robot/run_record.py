"""What the robot's side of a run keeps of every tick."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout, readings
from surefoot.robot_io.ticks.recorder import TickRecorder, TickSink
from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import lay_out
from surefoot.sim_robot.state_view import PlantTruth

SENSED = (
    *("q", "dq", "effort", "q_command"),
    *("quat_xyzw", "angular_velocity", "linear_acceleration", "ft_left", "ft_right"),
)
TRUE = (
    *("true_com", "true_com_velocity", "true_base_pose"),
    *("true_sole_left", "true_sole_right", "true_F"),
)
PLATFORM_POSE = "true_platform_pose"
BLOCK_ROWS = 64
"""Ticks hashed at a time; the digest does not depend on it."""


class RobotRecorder:
    """Hands on what the robot's side of a run knows of every tick.

    That is: its sensors, the command its servos follow, and the simulator's truth.
    """

    def __init__(
        self, sink: TickSink, *, joints: Sequence[str], platforms: int, period_s: float
    ) -> None:
        """Begin.

        Args:
            sink: gets the ticks.
            joints: names, in the order of the robot file.
            platforms: of the scenario.
            period_s: control period.
        """
        names = [*SENSED, *TRUE, *([PLATFORM_POSE] if platforms else [])]
        layouts = [
            lay_out(name, joints=joints, platforms=platforms)
            for name in ("tick", "time_s", *names)
        ]
        self._recorder = TickRecorder(layouts, sink)
        self._period_s = period_s
        self._time_s = np.zeros(1)

    def add(self, truth: PlantTruth, snapshot: Snapshot, q_command: Array) -> None:
        """Take in one tick; each tick once, in order."""
        self._time_s[0] = truth.tick * self._period_s
        platforms = [
            part
            for platform in truth.platforms
            for part in (platform.position, platform.quat_xyzw)
        ]
        self._recorder.add(
            truth.tick,
            (
                self._time_s,
                snapshot.q,
                snapshot.dq,
                snapshot.effort,
                q_command,
                snapshot.quat_xyzw,
                snapshot.angular_velocity,
                snapshot.linear_acceleration,
                snapshot.ft_left,
                snapshot.ft_right,
                truth.com,
                truth.com_velocity,
                truth.base_position,
                truth.base_quat_xyzw,
                truth.sole_left,
                truth.sole_right,
                truth.F_left,
                truth.F_right,
                *platforms,
            ),
        )


class RunDigest:
    """SHA-256 over every tick's sensors and the command it was stepped with.

    Each tick adds, as little-endian float64, all readings in the order of the sensor
    table, and the posture the servos were given. Stamps and timings are left out.
    """

    def __init__(self, *, joints: int) -> None:
        """Start with nothing.

        Args:
            joints: n_a.
        """
        self._sha = hashlib.sha256()
        width = SnapshotLayout(joints).size + joints
        self._rows = np.empty((BLOCK_ROWS, width), dtype="<f8")
        self._count = 0

    def add(self, snapshot: Snapshot, q_command: Array) -> None:
        """Take in one tick."""
        row = self._rows[self._count]
        np.concatenate((*readings(snapshot), q_command), out=row)
        self._count += 1
        if self._count == BLOCK_ROWS:
            self._sha.update(self._rows.data)
            self._count = 0

    def hexdigest(self) -> str:
        """Digest of all ticks so far."""
        whole = self._sha.copy()
        whole.update(self._rows[: self._count].data)
        return whole.hexdigest()
