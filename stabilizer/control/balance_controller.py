"""What both stabilizers share: observe, follow the reference, command, answer."""

from __future__ import annotations

from abc import ABC, abstractmethod

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.controller import ControllerOutput
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.errors import QpStatus
from surefoot.stabilizer.estimation.observer import ObservedState, Observer
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.qp import QpData, QpSolution


class BalanceController(ABC):
    """A controller that answers what its observer sees.

    A subclass makes ``observer`` and says what to command.

    Attributes:
        model: the robot.
        stance: reference.
        observer: tells the robot's state.
        failure: the first QP that could not be solved, kept for replay.
    """

    observer: Observer

    def __init__(self, robot: Robot, settings: ControllerSettings) -> None:
        """Build the model, and the reference of a robot that stands."""
        self._settings = settings
        self._dt = robot.period_s
        self.model = RobotModel(robot)
        self.stance = standing(self.model)
        self.failure: QpData | None = None
        self._tick = 0

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still, once.

        Args:
            snapshot: first reading of all sensors.
            q_command: (n_a,) posture the servos hold, bus order [rad].
        """
        self.observer.start(snapshot)
        self._take_over(q_command[self.model.to_model])

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick; the posture is held when something fails.

        Args:
            snapshot: reading of all sensors.
            reference: newest word of a planner, if any.

        Returns:
            Joint command in bus order, and what led to it.
        """
        self._tick = snapshot.tick
        state = self.observer.update(snapshot)
        if state is None:
            return self._answer(QpStatus.SENSORS_NOT_FINITE, QpStatus.NOT_TRIED)
        self.stance.follow(reference, self.model)
        wrench_qp, motion_qp = self._command(state)
        return self._answer(wrench_qp, motion_qp)

    @abstractmethod
    def _take_over(self, q_command: Array) -> None:
        """Begin at a posture.

        Args:
            q_command: (n_a,) model order [rad].
        """

    @abstractmethod
    def _command(self, state: ObservedState) -> tuple[QpStatus, QpStatus]:
        """Compute the command of this tick.

        Args:
            state: of the robot.

        Returns:
            What became of the QP for wrenches, and of the one for joint velocities.
        """

    @abstractmethod
    def _output(self) -> ControllerOutput:
        """Make the answer as it stands: the command, old or new, and what led to it."""

    def _answer(self, wrench_qp: QpStatus, motion_qp: QpStatus) -> ControllerOutput:
        output, state = self._output(), self.observer.state
        output.F_meas = state.F_meas
        output.com_reference = self.stance.com
        output.in_contact = (state.in_contact[0], state.in_contact[1])
        output.base_pose, output.base_twist = state.q[:7], state.v[:6]
        output.wrench_qp, output.motion_qp = wrench_qp, motion_qp
        return output

    def _fade(self, state: ObservedState) -> float:
        """Return the part of the motion carried out: little after the calibration."""
        return min(max(state.active_s / self._settings.dik.ramp_in_s, 0.0), 1.0)

    def _keep_failure(self, solution: QpSolution) -> None:
        """Keep the first problem that could not be solved."""
        if self.failure is None:
            self.failure = solution.problem.data(solution.status)
