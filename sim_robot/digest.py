"""Fingerprint of a run: equal runs have equal digests, bit for bit."""

from __future__ import annotations

import hashlib

import numpy as np

from robot_io.snapshot import Snapshot
from schemas.arrays import Array

BLOCK_ROWS = 64
"""Ticks hashed at a time; the digest does not depend on it."""
READINGS_BESIDE_JOINTS = 4 + 3 + 3 + 6 + 6
PER_JOINT = 4


class RunDigest:
    """SHA-256 over every tick's sensors and the command it was stepped with.

    Each tick adds, as little-endian float64: q, dq, effort, quat_xyzw,
    angular_velocity, linear_acceleration, ft_left, ft_right, and the posture the
    servos were given. Stamps and timings are left out.
    """

    def __init__(self, *, joints: int) -> None:
        """Starts with nothing.

        Args:
            joints: n_a.
        """
        self._sha = hashlib.sha256()
        width = PER_JOINT * joints + READINGS_BESIDE_JOINTS
        self._rows = np.empty((BLOCK_ROWS, width), dtype="<f8")
        self._count = 0

    def add(self, snapshot: Snapshot, q_command: Array) -> None:
        """Takes in one tick."""
        np.concatenate(
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
            out=self._rows[self._count],
        )
        self._count += 1
        if self._count == BLOCK_ROWS:
            self._sha.update(self._rows.data)
            self._count = 0

    def hexdigest(self) -> str:
        """Digest of all ticks so far."""
        whole = self._sha.copy()
        whole.update(self._rows[: self._count].data)
        return whole.hexdigest()
