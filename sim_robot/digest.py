"""Fingerprint of a run: equal runs have equal digests, bit for bit."""

from __future__ import annotations

import hashlib

import numpy as np

from robot_io.snapshot import Snapshot
from schemas.arrays import Array


class RunDigest:
    """SHA-256 over every tick's sensors and the command it was stepped with.

    Each tick adds, as little-endian float64: q, dq, effort, quat_xyzw,
    angular_velocity, linear_acceleration, ft_left, ft_right, and the posture the
    servos were given. Stamps and timings are left out.
    """

    def __init__(self) -> None:
        """Starts with nothing."""
        self._sha = hashlib.sha256()

    def add(self, snapshot: Snapshot, q_command: Array) -> None:
        """Takes in one tick."""
        row = np.concatenate(
            (
                snapshot.q,
                snapshot.dq,
                snapshot.effort,
                snapshot.quat_xyzw,
                snapshot.angular_velocity,
                snapshot.linear_acceleration,
                snapshot.ft_left,
                snapshot.ft_right,
                q_command,
            ),
            dtype="<f8",
        )
        self._sha.update(row.data)

    def hexdigest(self) -> str:
        """Digest of all ticks so far."""
        return self._sha.hexdigest()
