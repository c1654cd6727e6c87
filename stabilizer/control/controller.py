"""What every controller is: an object that answers snapshots with joint commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.qp import QpData


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
        """Begin on a robot that stands still.

        Args:
            snapshot: first reading of all sensors.
            q_command: (n_a,) posture the servos hold, bus order [rad].
        """

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick.

        Args:
            snapshot: reading of all sensors.
            reference: newest word of a planner, if any.
        """


@runtime_checkable
class Tunable(Protocol):
    """A controller that takes new gains; one without this keeps those it has."""

    def retune(self, settings: ControllerSettings) -> None:
        """Use these gains from the next step on.

        Args:
            settings: differ from those in use in LIVE_SETTINGS only.
        """


class HoldController:
    """Commands the posture it started from, whatever happens."""

    name = "hold"

    def __init__(self, joint_count: int) -> None:
        """Hold zeros until started.

        Args:
            joint_count: n_a.
        """
        self._output = ControllerOutput.holding(np.zeros(joint_count))
        self.failure: QpData | None = None

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still.

        Args:
            snapshot: first reading of all sensors; not needed here.
            q_command: (n_a,) posture the servos hold [rad].
        """
        del snapshot
        self._output = ControllerOutput.holding(q_command.copy())

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick with the posture it started from."""
        del snapshot, reference
        return self._output
