"""Sensor messages as a robot sends them, told apart by their tick."""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    ForceTorque,
    ImuState,
    JointState,
    Message,
)

JOINTS = 28


def snapshot_at(tick: int) -> Snapshot:
    """Sensors at a tick; every number differs from those of all other ticks."""
    numbers = np.random.default_rng(tick).normal(size=3 * JOINTS + 22)
    return Snapshot(
        tick=tick,
        stamp_ns=1000 + tick,
        q=numbers[:JOINTS],
        dq=numbers[JOINTS : 2 * JOINTS],
        effort=numbers[2 * JOINTS : 3 * JOINTS],
        quat_xyzw=numbers[-22:-18],
        angular_velocity=numbers[-18:-15],
        linear_acceleration=numbers[-15:-12],
        ft_left=numbers[-12:-6],
        ft_right=numbers[-6:],
    )


def message(name: str, tick: int) -> Message:
    """Message of one channel at a tick."""
    sensors = snapshot_at(tick)
    head = {"schema": SCHEMA_VERSION, "tick": tick, "stamp_ns": sensors.stamp_ns}
    if name == "joints":
        return JointState(
            **head,
            q=sensors.q.tolist(),
            dq=sensors.dq.tolist(),
            effort=sensors.effort.tolist(),
        )
    if name == "imu":
        return ImuState(
            **head,
            quat_xyzw=sensors.quat_xyzw.tolist(),
            angular_velocity=sensors.angular_velocity.tolist(),
            linear_acceleration=sensors.linear_acceleration.tolist(),
        )
    wrench = sensors.ft_left if name == "left_ankle_ft" else sensors.ft_right
    return ForceTorque(**head, force=wrench[:3].tolist(), moment=wrench[3:].tolist())
