"""Keeps the posture: the least a controller can do."""

from __future__ import annotations

import numpy as np

from robot_io.snapshot import Snapshot
from schemas.arrays import Array
from schemas.messages import Reference
from stabilizer.controller import ControllerOutput
from stabilizer.qp import QpData


class HoldController:
    """Commands the posture it started from, whatever happens."""

    name = "hold"

    def __init__(self, joint_count: int) -> None:
        """Holds zeros until started.

        Args:
            joint_count: n_a.
        """
        self._output = ControllerOutput.holding(np.zeros(joint_count))
        self.failure: QpData | None = None

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begins on a robot that stands still.

        Args:
            snapshot: first reading of all sensors; not needed here.
            q_command: (n_a,) posture the servos hold [rad].
        """
        del snapshot
        self._output = ControllerOutput.holding(q_command.copy())

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answers one tick with the posture it started from."""
        del snapshot, reference
        return self._output
