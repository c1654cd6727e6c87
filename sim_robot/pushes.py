"""Pushes: forces on bodies for a while."""

from __future__ import annotations

import difflib
import math

import mujoco
import numpy as np

from surefoot.schemas.arrays import Vec3
from surefoot.schemas.messages import PushRequest
from surefoot.schemas.rods import Rod
from surefoot.schemas.scenario import Push
from surefoot.sim_robot.errors import ScenarioError
from surefoot.sim_robot.rods import Rods
from surefoot.sim_robot.ticks import SIM_STEP_S
from surefoot.sim_robot.world import World

MAX_FORCE_N = 2000.0
MAX_DURATION_S = 5.0


class Pushes:
    """Applies the scenario's pushes at the centres of mass, in world axes.

    A push acts on whole simulation steps; pushes that overlap add up.

    Attributes:
        rods: of the scenario, at work.
    """

    def __init__(
        self, pushes: list[Push], world: World, *, rods: list[Rod] | None = None
    ) -> None:
        """Look up the bodies.

        Args:
            pushes: of the scenario.
            world: with the robot.
            rods: of the scenario; their forces are added.

        Raises:
            ScenarioError: a body does not exist or has no mass.
        """
        self._windows: list[tuple[int, int, int, Vec3]] = []
        self._bodies: list[int] = []
        self._valid = valid = _bodies_with_mass(world)
        for index, push in enumerate(pushes):
            if push.body not in valid:
                near = difflib.get_close_matches(push.body, valid, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ScenarioError(
                    f"push[{index}].body: got {push.body!r}, expected one of "
                    f"{', '.join(valid)}{hint}",
                    field=f"push[{index}].body",
                )
            first = round(push.start_s / SIM_STEP_S)
            last = round((push.start_s + push.duration_s) / SIM_STEP_S)
            body = valid[push.body]
            self._windows.append((first, last, body, np.array(push.force_n)))
            self._bodies.append(body)
        self.rods = Rods(rods or [], world.model, valid)
        self._bodies += [rod.body for rod in self.rods.at_work]

    def add(self, push: PushRequest, *, first_step: int) -> None:
        """Add a push that somebody asks for during the run.

        Args:
            push: body, force and duration.
            first_step: simulation step in which it begins.

        Raises:
            ScenarioError: the body does not exist or has no mass, or the push is
                beyond what a person would mean.
        """
        if push.body not in self._valid:
            raise ScenarioError(
                f"body: got {push.body!r}, expected one of {', '.join(self._valid)}",
                field="body",
            )
        if math.hypot(*push.force_n) > MAX_FORCE_N:
            raise ScenarioError(
                f"force_n: got {math.hypot(*push.force_n):g} N, expected at most "
                f"{MAX_FORCE_N:g} N",
                field="force_n",
            )
        if not SIM_STEP_S <= push.duration_s <= MAX_DURATION_S:
            raise ScenarioError(
                f"duration_s: got {push.duration_s:g} s, expected {SIM_STEP_S:g} to "
                f"{MAX_DURATION_S:g} s",
                field="duration_s",
            )
        body = self._valid[push.body]
        last = first_step + round(push.duration_s / SIM_STEP_S)
        self._windows.append((first_step, last, body, np.array(push.force_n)))
        self._bodies.append(body)

    def apply(self, data: mujoco.MjData, step: int) -> None:
        """Set the forces for simulation step ``step``, counted from zero."""
        if not self._bodies:
            return
        for body in self._bodies:
            data.xfrc_applied[body] = 0.0
        for first, last, body, force in self._windows:
            if first <= step < last:
                data.xfrc_applied[body, :3] += force
        self.rods.apply(data, step)


def _bodies_with_mass(world: World) -> dict[str, int]:
    model = world.model
    return {
        model.body(i).name: i
        for i in range(model.nbody)
        if model.body_rootid[i] == world.base_body and model.body_mass[i] > 0.0
    }
