"""Controller protocol, and the base class of both shipped controllers.

Data flow: snapshot -> :class:`Controller` -> joint positions. Safety wraps it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.messages import Reference
from surefoot.schemas.reasons import SensorTrouble
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.qp import QpData, QpSolution, QpStatus

if TYPE_CHECKING:
    from surefoot.stabilizer.estimation.observer import ObservedState, Observer
    from surefoot.stabilizer.walking.feet import WalkState

CONTROLLERS = ("whole-body", "zmp", "hold")
"""Names of the shipped controllers."""
CATCH_UP = 0.5
"""Motion of missed ticks that is made up for in one tick [ticks]: more at once would
jerk a robot whose drives follow at once."""
MOST_OWED_S = 0.01
"""Longest missed motion that is made up for [s]; after longer ones the feet tell where
to go."""


class ControllerError(ValueError):
    """A controller cannot be found or made, or breaks the controller protocol."""


@dataclass(slots=True)
class ControllerOutput:
    """Answer to one tick. Arrays are reused by the next one: copy what you keep.

    Only ``q_command`` is required. A field that the controller does not know stays
    None, and is left out of status, plots and ticks files.

    Attributes:
        q_command: (n_a,) joint positions to follow, bus order [rad].
        F_id: (12,) desired wrenches of the ground on left and right sole, sole frames
            [N, N m].
        F_meas: (12,) measured wrenches, in the same frames [N, N m].
        com: (3,) estimated centre of mass in the stance frame [m].
        com_reference: (3,) reference of the centre of mass, same frame [m].
        in_contact: whether left and right foot stand.
        base_pose: (7,) estimated base in the stance frame: position [m], quat_xyzw.
        base_twist: (6,) twist of the base in the base frame [m/s, rad/s].
        r: (12,) desired sole twists, sole frames [m/s, rad/s].
        v_joint: (n_a,) joint velocities of the second QP, bus order [rad/s].
        wrench_qp: status of the QP for F_id; ``ok`` when solved.
        motion_qp: status of the QP for joint velocities; ``ok`` when solved.
        walk: progress of the walk; None before there were steps.
    """

    q_command: Array
    F_id: Array | None = None
    F_meas: Array | None = None
    com: Vec3 | None = None
    com_reference: Vec3 | None = None
    in_contact: tuple[bool, bool] | None = None
    base_pose: Array | None = None
    base_twist: Array | None = None
    r: Array | None = None
    v_joint: Array | None = None
    wrench_qp: QpStatus = QpStatus.OK
    motion_qp: QpStatus = QpStatus.OK
    walk: WalkState | None = None

    @property
    def qp_status(self) -> str:
        """``ok``, or which QP failed and how."""
        if self.wrench_qp != QpStatus.OK:
            return f"wrenches: {self.wrench_qp}"
        if self.motion_qp != QpStatus.OK:
            return f"motion: {self.motion_qp}"
        return QpStatus.OK


class Controller(Protocol):
    """Pure control law: no clock, no I/O, deterministic.

    An object is started once. A new start uses a new object, so that nothing is left
    over from the last one.
    """

    name: str

    @property
    def failure(self) -> QpData | None:
        """The first QP that could not be solved, if any."""

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still; called once, before any step.

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
            reference: a planner's newest reference, if any.
        """


ControllerFactory = Callable[[ControllerSettings], Controller]
"""Makes a fresh controller with the present settings."""


@runtime_checkable
class PassesOver(Protocol):
    """A controller that takes in ticks which get no answer; others never see them."""

    def pass_over(self, snapshot: Snapshot) -> None:
        """Take in a tick that gets no answer: the robot keeps its last command.

        Args:
            snapshot: reading of all sensors.
        """


@runtime_checkable
class Tunable(Protocol):
    """A controller that takes new gains; others keep the gains they were made with."""

    def retune(self, settings: ControllerSettings) -> None:
        """Use these gains from the next step on.

        Args:
            settings: may differ from the present ones in LIVE_SETTINGS only.
        """


@runtime_checkable
class Walks(Protocol):
    """A controller that takes footsteps; others only stand."""

    def follow_plan(self, plan: WalkPlan) -> None:
        """Follow a plan from the next call of ``step`` on; only called once started.

        Args:
            plan: the newest plan; its steps replace those that have not begun.
        """


@runtime_checkable
class Degradable(Protocol):
    """A controller that can go on without ankle sensors."""

    def degrade(self, lost: tuple[bool, bool]) -> None:
        """Leave out the readings of lost sensors.

        Args:
            lost: whether left and right ankle sensor are lost.
        """


@runtime_checkable
class UndoesOverload(Protocol):
    """A controller that takes back what false forces made it do; others go on."""

    def undo_overload(
        self, q_command: Array, *, ticks: int, sides: tuple[bool, bool]
    ) -> None:
        """Return to the command from before a period of false forces.

        Args:
            q_command: (n_a,) the command before that period, bus order [rad].
            ticks: length of the period; the return takes as long.
            sides: whether the forces of left and right foot were false.
        """


@runtime_checkable
class Doubts(Protocol):
    """A controller that compares the IMU with legs and feet."""

    def imu_trouble(self) -> tuple[SensorTrouble | None, str]:
        """Return what is wrong with the IMU, and why in words.

        With an offset the run goes on, with any other trouble it ends.
        """


class BalanceController(ABC):
    """A controller that works on the state from its observer.

    A subclass makes ``observer`` and computes the command.

    Attributes:
        model: the robot.
        stance: reference.
        com_wanted: (3,) reference of the centre of mass in this tick [m].
        observer: estimates the robot's state.
        failure: the first QP that could not be solved, kept for replay.
    """

    name: str
    observer: Observer

    def __init__(self, robot: Robot, settings: ControllerSettings) -> None:
        """Build the model and the standing reference."""
        # Imported here: the controller protocol alone needs no dynamics.
        from surefoot.stabilizer.control.reference import standing
        from surefoot.stabilizer.model import RobotModel

        self._settings = settings
        self._dt = robot.period_s
        self.model = RobotModel(robot)
        self.stance = standing(self.model)
        self.com_wanted = self.stance.com
        self.failure: QpData | None = None
        self._tick, self._is_started = 0, False
        self._owed, self._most_owed = 0.0, MOST_OWED_S / robot.period_s

    def imu_trouble(self) -> tuple[SensorTrouble | None, str]:
        """See :class:`Doubts`."""
        return self.observer.imu_trouble

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still, once.

        Raises:
            ControllerError: it has been started before.
        """
        if self._is_started:
            raise ControllerError(
                f"controller {self.name}: started twice, expected a new one for each "
                "start: it knows the last run"
            )
        self._is_started = True
        self.observer.start(snapshot)
        self._take_over(q_command[self.model.to_model])

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick; if something fails, the posture is held.

        Returns:
            Joint command in bus order, and the quantities it was computed from.
        """
        self._tick = snapshot.tick
        state = self.observer.update(snapshot)
        if state is None:
            return self._answer(QpStatus.SENSORS_NOT_FINITE, QpStatus.NOT_TRIED)
        self.stance.follow(reference, self.model)
        wrench_qp, motion_qp = self._command(state)
        return self._answer(wrench_qp, motion_qp)

    def pass_over(self, snapshot: Snapshot) -> None:
        """Take in a tick that gets no answer; see :class:`PassesOver`."""
        self._tick = snapshot.tick
        self._owed = min(self._owed + 1.0, self._most_owed)
        state = self.observer.pass_over(snapshot)
        if state is not None:
            self._look_on(state)

    @abstractmethod
    def _take_over(self, q_command: Array) -> None:
        """Begin at a posture.

        Args:
            q_command: (n_a,) model order [rad].
        """

    @abstractmethod
    def _command(self, state: ObservedState) -> tuple[QpStatus, QpStatus]:
        """Compute the command of this tick.

        Returns:
            Status of the wrench QP and of the joint velocity QP.
        """

    @abstractmethod
    def _look_on(self, state: ObservedState) -> None:
        """Let a tick without a command pass in all that counts time."""

    @abstractmethod
    def _output(self) -> ControllerOutput:
        """Make the answer from the present command, old or new, and its quantities."""

    def _answer(self, wrench_qp: QpStatus, motion_qp: QpStatus) -> ControllerOutput:
        output, state = self._output(), self.observer.state
        output.F_meas = state.F_meas
        output.com_reference = self.com_wanted
        output.in_contact = (state.in_contact[0], state.in_contact[1])
        output.base_pose, output.base_twist = state.q[:7], state.v[:6]
        output.wrench_qp, output.motion_qp = wrench_qp, motion_qp
        return output

    def _ticks_of_motion(
        self, state: ObservedState, *, most: float = CATCH_UP
    ) -> float:
        """Return for how many ticks to move now.

        Less than one at first: the motion fades in after calibration. More than one
        after missed ticks, in which the robot kept its command.

        Args:
            state: of the robot.
            most: largest number of missed ticks to make up for at once.
        """
        owed = min(self._owed, most)
        self._owed -= owed
        fade = min(max(state.active_s / self._settings.dik.ramp_in_s, 0.0), 1.0)
        return fade * (1.0 + owed)

    def _keep_failure(self, solution: QpSolution) -> None:
        """Keep the first problem that could not be solved."""
        if self.failure is None:
            self.failure = solution.problem.data(solution.status)


class HoldController:
    """Commands the posture it started from, in every tick."""

    name = "hold"

    def __init__(self, joint_count: int) -> None:
        """Hold zeros until started."""
        self._output = ControllerOutput(np.zeros(joint_count))
        self.failure: QpData | None = None

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still.

        Args:
            snapshot: first reading of all sensors; not needed here.
            q_command: (n_a,) posture the servos hold [rad].
        """
        del snapshot
        self._output = ControllerOutput(q_command.copy())

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick with the posture it started from."""
        del snapshot, reference
        return self._output
