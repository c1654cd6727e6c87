"""Per-tick arrays of a run, for plots and pictures."""

from __future__ import annotations

import hashlib

import numpy as np

from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout, readings
from surefoot.schemas.arrays import Array
from surefoot.sim_robot.truth import PlantTruth

BLOCK_ROWS = 64
"""Ticks hashed at a time; the digest does not depend on it."""


class RunRecord:
    """Keeps the truth, the joints and the command of every tick.

    Memory for the whole run is taken at the start.
    """

    def __init__(
        self, *, ticks: int, joints: int, platforms: int, period_s: float
    ) -> None:
        """Make room.

        Args:
            ticks: most ticks to keep; later ones are dropped.
            joints: n_a.
            platforms: platforms of the scenario.
            period_s: control period.
        """
        self._period_s = period_s
        self._count = 0
        self._rows: dict[str, Array] = {
            "time_s": np.empty(ticks),
            "com": np.empty((ticks, 3)),
            "com_velocity": np.empty((ticks, 3)),
            "base_position": np.empty((ticks, 3)),
            "base_quat_xyzw": np.empty((ticks, 4)),
            "sole_left": np.empty((ticks, 3)),
            "sole_right": np.empty((ticks, 3)),
            "F_left": np.empty((ticks, 6)),
            "F_right": np.empty((ticks, 6)),
            "q": np.empty((ticks, joints)),
            "q_command": np.empty((ticks, joints)),
            "platform_position": np.empty((ticks, platforms, 3)),
            "platform_quat_xyzw": np.empty((ticks, platforms, 4)),
        }
        self._truth_rows = [
            (rows, name)
            for name, rows in self._rows.items()
            if name in PlantTruth.__slots__
        ]

    def add(self, truth: PlantTruth, snapshot: Snapshot, q_command: Array) -> None:
        """Keep one tick; each tick once, in order."""
        row = self._count
        rows = self._rows
        if row >= len(rows["time_s"]):
            return
        self._count = row + 1
        rows["time_s"][row] = truth.tick * self._period_s
        for column, name in self._truth_rows:
            column[row] = getattr(truth, name)
        rows["q"][row] = snapshot.q
        rows["q_command"][row] = q_command
        for index, platform in enumerate(truth.platforms):
            rows["platform_position"][row, index] = platform.position
            rows["platform_quat_xyzw"][row, index] = platform.quat_xyzw

    def arrays(self) -> dict[str, Array]:
        """What was kept, by name, first axis ticks: ready for ``numpy.savez``.

        ``time_s`` [s]; ``com``, ``com_velocity``, ``base_position``,
        ``base_quat_xyzw``, ``sole_left``, ``sole_right``, ``F_left``, ``F_right``
        as in :class:`PlantTruth`; ``q`` as measured and ``q_command`` as given to
        the servos (n_a) [rad]; ``platform_position``, ``platform_quat_xyzw`` by
        platform of the scenario.
        """
        return {name: rows[: self._count] for name, rows in self._rows.items()}


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
