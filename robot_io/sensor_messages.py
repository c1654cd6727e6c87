"""Messages of a tick from a snapshot of the sensors."""

from __future__ import annotations

from robot_io.snapshot import Snapshot
from schemas.messages import SCHEMA_VERSION, ForceTorque, ImuState, JointState


def sensor_messages(
    snapshot: Snapshot, *, stamp_ns: int
) -> tuple[JointState, ImuState, ForceTorque, ForceTorque]:
    """Takes a snapshot apart, one message per sensor.

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
