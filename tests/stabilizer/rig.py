"""Everything one tick needs, at a given state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.dik import Dik
from surefoot.stabilizer.control.reference import Stance, standing
from surefoot.stabilizer.control.tasks import Task, standing_tasks
from surefoot.stabilizer.control.tsid import Tsid
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.qp import PiqpSolver, QpSolution, QpSolver
from tests.stabilizer.states import State

BOTH, LEFT, RIGHT = [True, True], [True, False], [False, True]
CONTACT_SETS = [BOTH, LEFT, RIGHT]
CONTACT_NAMES = ["both", "left", "right"]


class Rig:
    """Dynamics, stance and both QPs of one robot, called as the controller does.

    Attributes:
        weight: weight of the robot [N].
        q: (7 + n_a,) configuration of the last :meth:`go`.
        extra_tasks: tasks beside those of a standing robot.
    """

    def __init__(
        self,
        model: RobotModel,
        settings: ControllerSettings | None = None,
        *,
        extra_tasks: Sequence[Task] = (),
        solver: Callable[[], QpSolver] = PiqpSolver,
    ) -> None:
        self.model = model
        self.settings = settings or ControllerSettings()
        self.dynamics = Dynamics(model)
        self.stance: Stance = standing(model)
        self.extra_tasks = extra_tasks
        tasks = [*standing_tasks(model, self.settings), *extra_tasks]
        self.tsid = Tsid(model, self.settings.tsid, tasks, solver=solver)
        self.dik = Dik(model, self.settings.dik, tasks, solver=solver)
        self.weight = model.mass * GRAVITY

    @property
    def q(self) -> Array:
        return self.dynamics.q

    @property
    def largest_force(self) -> float:
        """Largest normal force that may be asked of a standing foot [N]."""
        return self.settings.tsid.normal_force_max_weights * self.weight

    def ask(self, rng: np.random.Generator, *, position: float, speed: float) -> None:
        """Change all references at random, as a planner may.

        Args:
            rng: source of the random numbers.
            position: distance from the stance [m, rad].
            speed: speed of the CoM [m/s]; its acceleration is ten times that [m/s^2].
        """
        stance, nominal = self.stance, standing(self.model)
        stance.com[:] = nominal.com + position * rng.normal(size=3)
        stance.com_velocity[:] = speed * rng.normal(size=3)
        stance.com_acceleration[:] = 10.0 * speed * rng.normal(size=3)
        stance.R_base[:] = pin.exp3(position * rng.normal(size=3))
        stance.posture[:] = nominal.posture + position * rng.normal(size=self.model.n_a)

    def go(self, state: State) -> Dynamics:
        """Put the robot into a state."""
        self.dynamics.update(state.q, state.v)
        self.stance.compare_base(state.base_rotation)
        return self.dynamics

    def solve_tsid(self, in_contact: list[bool] | None = None) -> QpSolution:
        """Solve the first QP; both feet stand unless given otherwise."""
        return self.tsid.solve(
            self.dynamics,
            self.stance,
            in_contact=in_contact or BOTH,
            allowed=np.full(2, self.largest_force),
        )

    def solve_dik(self, r: Array, *, q_command: Array | None = None) -> QpSolution:
        """Solve the second QP; the command is the joints' position unless given."""
        if q_command is None:
            q_command = self.dynamics.q[7:].copy()
        return self.dik.solve(self.dynamics, self.stance, r=r, q_command=q_command)
