"""Everything one tick needs, at a state of the test's choosing."""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.dik import Dik
from surefoot.stabilizer.control.reference import Stance, standing
from surefoot.stabilizer.control.tsid import Tsid
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.qp import QpSolution
from tests.stabilizer.states import State

BOTH, LEFT, RIGHT = [True, True], [True, False], [False, True]
CONTACT_SETS = [BOTH, LEFT, RIGHT]
CONTACT_NAMES = ["both", "left", "right"]


class Rig:
    """Dynamics, stance and both QPs of one robot, called as the controller does.

    Attributes:
        weight: of the robot [N].
        q: (7 + n_a,) configuration of the last :meth:`go`.
    """

    def __init__(
        self, model: RobotModel, settings: ControllerSettings | None = None
    ) -> None:
        self.model = model
        self.settings = settings or ControllerSettings()
        self.dynamics = Dynamics(model)
        self.stance: Stance = standing(model)
        self.tsid = Tsid(model, self.settings.tsid)
        self.dik = Dik(model, self.settings.dik)
        self.weight = model.mass * GRAVITY

    @property
    def q(self) -> Array:
        return self.dynamics.q

    @property
    def largest_force(self) -> float:
        """Normal force that may be asked of a standing foot [N]."""
        return self.settings.tsid.normal_force_max_weights * self.weight

    def go(self, state: State) -> Dynamics:
        """Put the robot into a state."""
        self.dynamics.update(state.q, state.v)
        self.stance.compare_base(state.base_rotation)
        return self.dynamics

    def solve_tsid(self, in_contact: list[bool] | None = None) -> QpSolution:
        """First QP; both feet stand unless said otherwise."""
        return self.tsid.solve(
            self.dynamics,
            self.stance,
            in_contact=in_contact or BOTH,
            allowed=np.full(2, self.largest_force),
        )

    def solve_dik(self, r: Array, *, q_command: Array | None = None) -> QpSolution:
        """Second QP; the command is where the joints are unless said otherwise."""
        if q_command is None:
            q_command = self.dynamics.q[7:].copy()
        return self.dik.solve(self.dynamics, self.stance, r=r, q_command=q_command)
