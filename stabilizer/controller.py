"""Controller protocol, base class of both controllers, and adapter for foreign ones.

Data flow: snapshot -> :class:`Controller` -> joint positions. Safety wraps it.
"""

from __future__ import annotations

import importlib
import inspect
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.qp import QpData, QpSolution, QpStatus

if TYPE_CHECKING:
    from surefoot.stabilizer.estimation.observer import ObservedState, Observer
    from surefoot.stabilizer.walking.feet import WalkState

OPTIONAL = ("pass_over", "retune", "degrade", "undo_overload")
"""Optional methods, of :class:`PassesOver`, :class:`Tunable` and :class:`Degradable`,
used if present."""
CATCH_UP = 0.5
"""Motion of missed ticks that is made up for in one tick [ticks]: more at once would
jerk a robot whose drives follow at once."""
MOST_OWED_S = 0.01
"""Longest missed motion that is made up for [s]; after longer ones the feet tell where
to go."""


class ControllerError(ValueError):
    """A controller cannot be found or made, or breaks the controller protocol."""


_CALLERS = ("<", str(Path(__file__).parents[1]), str(Path(importlib.__file__).parent))
"""Beginnings of files that call a user's code: frozen, the library's, importlib's."""
_LONGEST_TEXT = 200


def told_of(error: BaseException) -> str:
    """Return an exception of a user's code on one line: class, message and place.

    The place is the deepest line of the file in which the user's code began.
    """
    if isinstance(error, ControllerError):
        return str(error)
    if isinstance(error, SyntaxError):
        file = Path(error.filename or "").name
        return f"{file}, line {error.lineno}: {error.msg}"
    message = " ".join(str(error).split())[:_LONGEST_TEXT]
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    frames = traceback.extract_tb(error.__traceback__)
    files = [frame.filename for frame in frames]
    begun = next((f for f in files if not f.startswith(_CALLERS)), files[-1])
    lines = [frame.lineno for frame in frames if frame.filename == begun]
    return f"{text} ({Path(begun).name}, line {lines[-1]})"


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
    failure: QpData | None
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
        self._tick = 0
        self._owed, self._most_owed = 0.0, MOST_OWED_S / robot.period_s

    @property
    def doubt(self) -> str:
        """See :class:`Doubts`."""
        return self.observer.doubt

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still, once."""
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


class ForeignController:
    """Wraps any object with ``start(snapshot, q_command)`` and ``step(snapshot, ...)``.

    ``step`` may return a bare array of joint positions or a :class:`ControllerOutput`.
    It may have no parameter for the reference.

    Attributes:
        name: as reported on status.
        inner: the object itself.
        failure: always None; a foreign controller keeps its own failures.
    """

    def __init__(self, inner: Any, *, n_a: int, name: str | None = None) -> None:
        """Check that the object has what a controller needs.

        Raises:
            ControllerError: a method is missing.
        """
        kind = type(inner).__name__
        missing = [m for m in ("start", "step") if not callable(getattr(inner, m, 0))]
        if missing:
            raise ControllerError(
                f"controller {name or kind}: {kind} has no {' and no '.join(missing)}; "
                "expected start(snapshot, q_command) and step(snapshot, reference)"
            )
        self.inner = inner
        self.name = name or str(getattr(inner, "name", kind))
        self.failure: QpData | None = None
        self._n_a = n_a
        self._takes_reference = _takes_two(inner.step)
        self._output = ControllerOutput(np.zeros(n_a))
        for method in OPTIONAL:
            if callable(getattr(inner, method, None)):
                setattr(self, method, getattr(inner, method))

    def start(self, snapshot: Snapshot, q_command: np.ndarray) -> None:
        """Begin on a robot that stands still; see :meth:`Controller.start`."""
        self.inner.start(snapshot, q_command)

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick.

        Raises:
            ControllerError: the answer is not one number per joint.
        """
        answer = (
            self.inner.step(snapshot, reference)
            if self._takes_reference
            else self.inner.step(snapshot)
        )
        if isinstance(answer, ControllerOutput):
            self._check(answer.q_command)
            return answer
        try:
            q_command = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            q_command = np.zeros(0)
        self._check(q_command, answer)
        self._output.q_command = q_command
        return self._output

    def _check(self, q_command: np.ndarray, answer: object = None) -> None:
        if q_command.shape != (self._n_a,):
            got = f"shape {q_command.shape}" if q_command.size else repr(answer)[:60]
            raise ControllerError(
                f"controller {self.name}: step returned {got}, expected "
                f"({self._n_a},): one position per joint of the robot file [rad]"
            )


def _takes_two(step: Any) -> bool:
    """Return whether a method can be called with snapshot and reference."""
    try:
        inspect.signature(step).bind(None, None)
    except TypeError:
        return False
    except ValueError:
        return True
    return True
