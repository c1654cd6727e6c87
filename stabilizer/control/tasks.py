"""Tasks of both QPs, one class each.

A task is a number of rows J of the robot's velocity v = (base twist, joint
velocities). The first QP wants its acceleration, the second its velocity:

    first QP    |J vdot + Jdot v - y|^2, y from :meth:`Task.acceleration`
    second QP   |J v - y|^2,             y from :meth:`Task.velocity`

with a weight for each row. A new task is a subclass of :class:`Task`, given to
``WholeBodyController(..., extra_tasks=[...])``; examples/hand_task.py is one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.law_settings import DikSettings, TsidSettings
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, RobotModel

BASE_ROTATION = slice(3, N_BASE_V)
"""Entries of the base's angular velocity in v."""


class Task(ABC):
    """Rows that both QPs, or one of them, fulfil as well as they can.

    Weights and sizes are read once, when the QPs are built. A task computes from its
    arguments and gains alone, and keeps nothing from tick to tick.

    Attributes:
        size: number of rows.
        acceleration_weights: (size,) in the first QP, where the centre of mass has
            1 [1]; None: not a task of the first QP.
        velocity_weights: (size,) in the second QP, where the centre of mass has 10
            [1]; None: not a task of the second QP.
    """

    size: int
    acceleration_weights: Array | None
    velocity_weights: Array | None

    @abstractmethod
    def jacobian(self, dynamics: Dynamics) -> Mat:
        """Return the rows J, (size, n_v)."""

    def weights_without(self, lost: Sequence[int]) -> Array | None:
        """Return the weights in the first QP while feet have lost the ground.

        Args:
            lost: feet without ground, 0 left and 1 right; not those in the air by a
                step.
        """
        del lost
        return self.acceleration_weights

    def drift(self, dynamics: Dynamics) -> Array:
        """Return Jdot v, (size,): the acceleration while vdot is zero.

        Raises:
            NotImplementedError: the task is one of the first QP and does not say.
        """
        raise self._left_out("drift")

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        """Write the acceleration that the first QP should reach.

        Raises:
            NotImplementedError: the task is one of the first QP and does not say.
        """
        raise self._left_out("acceleration")

    def velocity(
        self, dynamics: Dynamics, stance: Stance, q_command: Array, out: Array
    ) -> None:
        """Write the velocity that the second QP should reach.

        Args:
            dynamics: quantities at the present state.
            stance: reference.
            q_command: (n_a,) present joint command, model order [rad].
            out: (size,) to be filled.

        Raises:
            NotImplementedError: the task is one of the second QP and does not say.
        """
        raise self._left_out("velocity")

    def retune(self, settings: ControllerSettings) -> None:
        """Take new gains; a task without gains in the settings does nothing.

        Args:
            settings: may differ from the present ones in LIVE_SETTINGS only.
        """
        del settings

    def _left_out(self, method: str) -> NotImplementedError:
        name, qp = type(self).__name__, "velocity"
        if method != "velocity":
            qp = "acceleration"
        return NotImplementedError(
            f"{name} has {qp}_weights but no {method}(): "
            f"write that method, or set {qp}_weights to None"
        )


class SelectionTask(Task):
    """A task on some entries of v itself: J selects them, and Jdot is zero.

    Both QPs copy rows instead of multiplying by J.
    """

    columns: slice

    def jacobian(self, dynamics: Dynamics) -> Mat:
        """Return rows of the identity."""
        picked: Mat = np.eye(dynamics.model.n_v)[self.columns]
        return picked

    def drift(self, dynamics: Dynamics) -> Array:
        """Return zeros."""
        del dynamics
        return np.zeros(self.size)


class ComTask(Task):
    """The centre of mass follows its reference, in world axes."""

    size = 3

    def __init__(self, settings: ControllerSettings) -> None:
        """Read weights and gains."""
        self.acceleration_weights = np.full(3, settings.tsid.com_weight)
        self.velocity_weights = np.array(settings.dik.com_weight)
        self.retune(settings)

    def retune(self, settings: ControllerSettings) -> None:
        """Take new gains."""
        self._kp = np.array(settings.tsid.com_kp)
        self._kd = np.array(settings.tsid.com_kd)
        self._pull_gain = settings.ground.pull_gain
        self._gain = np.array(settings.dik.com_gain)

    def jacobian(self, dynamics: Dynamics) -> Mat:
        """Return the centre of mass's Jacobian."""
        return dynamics.J_com

    def drift(self, dynamics: Dynamics) -> Array:
        """Return its drift [m/s^2]."""
        return dynamics.Jdot_v_com

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        """Write a PD law plus the accelerations of reference and ground [m/s^2]."""
        out[:] = (
            stance.com_acceleration
            + self._pull_gain * stance.ground_acceleration
            + self._kp * (stance.com - dynamics.p_com)
            + self._kd * (stance.com_velocity - dynamics.v_com)
        )

    def velocity(
        self, dynamics: Dynamics, stance: Stance, q_command: Array, out: Array
    ) -> None:
        """Write a P law plus the reference's velocity [m/s]."""
        del q_command
        error = stance.com - dynamics.p_com
        out[:] = stance.com_velocity + self._gain * error


class BaseOrientationTask(SelectionTask):
    """The base turns to its reference, in base axes."""

    size = 3
    columns = BASE_ROTATION

    def __init__(self, settings: ControllerSettings) -> None:
        """Read weights and gains."""
        self.acceleration_weights = np.full(3, settings.tsid.base_weight)
        self.velocity_weights = np.full(3, settings.dik.base_weight)
        self.retune(settings)

    def retune(self, settings: ControllerSettings) -> None:
        """Take new gains."""
        self._kp, self._kd = settings.tsid.base_kp, settings.tsid.base_kd
        self._gain = settings.dik.base_gain

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        """Write a PD law [rad/s^2]."""
        np.multiply(stance.base_error, self._kp, out=out)
        out -= self._kd * dynamics.v[BASE_ROTATION]

    def velocity(
        self, dynamics: Dynamics, stance: Stance, q_command: Array, out: Array
    ) -> None:
        """Write a P law [rad/s]."""
        del dynamics, q_command
        np.multiply(stance.base_error, self._gain, out=out)


class PostureTask(SelectionTask):
    """The joints return to their reference; the legs weakly, to follow the ground."""

    columns = slice(N_BASE_V, None)

    def __init__(self, model: RobotModel, settings: ControllerSettings) -> None:
        """Read weights and gains."""
        self.size = model.n_a
        self.acceleration_weights = _posture_weights(model, settings.tsid)
        self._legs, self._other = model.leg_joints, settings.tsid.posture_weight
        self.velocity_weights = _posture_weights(model, settings.dik)
        self.retune(settings)

    def weights_without(self, lost: Sequence[int]) -> Array:
        """Return weights with which a leg in the air keeps its posture, as the arms do.

        The second QP swings no leg. If the first QP assumed a swing, it would count on
        the swing to hold the robot up.
        """
        weights: Array = np.array(self.acceleration_weights)
        for foot in lost:
            weights[self._legs[foot]] = self._other
        return weights

    def retune(self, settings: ControllerSettings) -> None:
        """Take new gains."""
        self._kp, self._kd = settings.tsid.posture_kp, settings.tsid.posture_kd
        self._gain = settings.dik.posture_gain

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        """Write a PD law on the measured joints [rad/s^2]."""
        np.subtract(stance.posture, dynamics.q[7:], out=out)
        out *= self._kp
        out -= self._kd * dynamics.v[N_BASE_V:]

    def velocity(
        self, dynamics: Dynamics, stance: Stance, q_command: Array, out: Array
    ) -> None:
        """Write a P law on the commanded joints [rad/s]."""
        del dynamics
        np.subtract(stance.posture, q_command, out=out)
        out *= self._gain


class SoleTwistTask(Task):
    """The soles move as the wrench law asks, in sole axes; second QP only.

    Attributes:
        r: (12,) desired twists of left and right sole, set before every solve.
    """

    size = 12
    acceleration_weights = None

    def __init__(self, settings: DikSettings) -> None:
        """Read weights."""
        self.velocity_weights = np.array(settings.contact_weight * 2)
        self.r: Array = np.zeros(12)

    def jacobian(self, dynamics: Dynamics) -> Mat:
        """Return the soles' Jacobian."""
        return dynamics.J_contact

    def velocity(
        self, dynamics: Dynamics, stance: Stance, q_command: Array, out: Array
    ) -> None:
        """Write r [m/s, rad/s]."""
        del dynamics, stance, q_command
        out[:] = self.r


class LoadTask:
    """The standing feet share the robot's weight as planned, straight up.

    It is a task on wrenches, not on motion: only the first QP has it.

    Attributes:
        weights: (6,) for one foot's force [N^-2] and moment [(N m)^-2].
    """

    def __init__(self, model: RobotModel, settings: TsidSettings) -> None:
        """Read weights."""
        self.weights = np.array(
            [settings.force_weight] * 3 + [settings.moment_weight] * 3
        )
        self._weight = model.mass * GRAVITY

    def wrenches(
        self, dynamics: Dynamics, stance: Stance, feet: tuple[int, ...], out: Array
    ) -> None:
        """Write the wrenches that the first QP should reach, in sole frames.

        Args:
            dynamics: quantities at the present state.
            stance: has the planned load of both feet; equal shares when standing.
            feet: the standing feet.
            out: (6 n,) for n standing feet; the caller has set the moments to zero.
        """
        for i, foot in enumerate(feet):
            share = stance.load[foot] if len(feet) > 1 else 1.0
            up = dynamics.R_world_sole[foot][2]
            out[6 * i : 6 * i + 3] = share * self._weight * up


def standing_tasks(model: RobotModel, settings: ControllerSettings) -> list[Task]:
    """Make the tasks of a robot that stands: centre of mass, base, posture."""
    return [
        ComTask(settings),
        BaseOrientationTask(settings),
        PostureTask(model, settings),
    ]


def weight_roots(task: Task, weights: Array) -> Array:
    """Return the square roots of a task's weights, which scale its rows, (size,).

    Raises:
        ValueError: there are more or fewer weights than rows, or one is negative.
    """
    if np.shape(weights) != (task.size,) or not (weights >= 0.0).all():
        raise ValueError(
            f"{type(task).__name__}: got weights {weights}, expected {task.size} "
            "numbers of zero or more, one for each row"
        )
    roots: Array = np.sqrt(weights)
    return roots


def _posture_weights(model: RobotModel, settings: TsidSettings | DikSettings) -> Array:
    """Return the weights of the joints, (n_a,), small for the legs."""
    return np.where(model.is_leg, settings.leg_posture_weight, settings.posture_weight)
