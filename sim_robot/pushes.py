"""Pushes: forces on bodies for a while."""

from __future__ import annotations

import mujoco
import numpy as np

from schemas.arrays import Vec3
from schemas.scenario import Push
from sim_robot.constants import SIM_STEP_S
from sim_robot.errors import ScenarioError
from sim_robot.world import World


class Pushes:
    """Applies the scenario's pushes at the centres of mass, in world axes.

    A push acts on whole simulation steps; pushes that overlap add up.
    """

    def __init__(self, pushes: list[Push], world: World) -> None:
        """Looks up the bodies.

        Raises:
            ScenarioError: a body does not exist or has no mass.
        """
        self._windows: list[tuple[int, int, int, Vec3]] = []
        self._bodies: list[int] = []
        valid = _bodies_with_mass(world)
        for index, push in enumerate(pushes):
            if push.body not in valid:
                raise ScenarioError(
                    f"push[{index}].body: got {push.body!r}, expected one of "
                    f"{', '.join(valid)}",
                    field=f"push[{index}].body",
                )
            first = round(push.start_s / SIM_STEP_S)
            last = round((push.start_s + push.duration_s) / SIM_STEP_S)
            body = valid[push.body]
            self._windows.append((first, last, body, np.array(push.force_n)))
            self._bodies.append(body)

    def apply(self, data: mujoco.MjData, step: int) -> None:
        """Sets the forces for simulation step ``step``, counted from zero."""
        if not self._windows:
            return
        for body in self._bodies:
            data.xfrc_applied[body] = 0.0
        for first, last, body, force in self._windows:
            if first <= step < last:
                data.xfrc_applied[body, :3] += force


def _bodies_with_mass(world: World) -> dict[str, int]:
    model = world.model
    return {
        model.body(i).name: i
        for i in range(model.nbody)
        if model.body_rootid[i] == world.base_body and model.body_mass[i] > 0.0
    }
