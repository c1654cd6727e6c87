"""What every controller is: an object that answers snapshots with joint commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from robot_io.snapshot import Snapshot
from schemas.arrays import Array, Vec3
from schemas.messages import Reference
from stabilizer.qp import QpData


@dataclass(frozen=True, slots=True)
class ControllerOutput:
    """Answer to one tick; arrays are reused by the next, do not keep or write them.

    Attributes:
        q_command: (n_a,) joint positions to follow, bus order [rad].
        F_id: (12,) wanted wrenches at left and right sole, sole frames [N, N m].
        F_meas: (12,) measured wrenches there.
        com: (3,) estimated centre of mass in the stance frame [m].
        com_reference: (3,) where it should be [m].
        in_contact: whether left and right foot stand.
        qp_status: ``ok``, or which QP failed and how.
    """

    q_command: Array
    F_id: Array
    F_meas: Array
    com: Vec3
    com_reference: Vec3
    in_contact: tuple[bool, bool]
    qp_status: str

    @classmethod
    def holding(cls, q_command: Array) -> ControllerOutput:
        """An answer that holds a posture and tells nothing of wrenches.

        Args:
            q_command: (n_a,) the posture, bus order [rad]; kept, not copied.
        """
        return cls(
            q_command=q_command,
            F_id=np.zeros(12),
            F_meas=np.zeros(12),
            com=np.zeros(3),
            com_reference=np.zeros(3),
            in_contact=(True, True),
            qp_status="ok",
        )


class Controller(Protocol):
    """Pure control law: no clock, no I/O, deterministic."""

    name: str
    failure: QpData | None
    """The first QP that could not be solved, if any."""

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begins on a robot that stands still.

        Args:
            snapshot: first reading of all sensors.
            q_command: (n_a,) posture the servos hold, bus order [rad].
        """

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answers one tick.

        Args:
            snapshot: reading of all sensors.
            reference: newest word of a planner, if any.
        """
