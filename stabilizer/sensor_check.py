"""Whether a snapshot can be computed with."""

from __future__ import annotations

import math

from robot_io.snapshot import Snapshot


def is_finite(snapshot: Snapshot) -> bool:
    """Whether every reading used is a number: sums of squares cannot cancel out."""
    q, dq = snapshot.q, snapshot.dq
    gyro, accel = snapshot.angular_velocity, snapshot.linear_acceleration
    left, right = snapshot.ft_left, snapshot.ft_right
    total = q.dot(q) + dq.dot(dq) + gyro.dot(gyro) + accel.dot(accel)
    return math.isfinite(total + left.dot(left) + right.dot(right))
