"""Pushes: forces on bodies for a while."""

from __future__ import annotations

import difflib
import itertools
import math

import mujoco
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.messages import PushRequest
from surefoot.schemas.scenario import Push
from surefoot.schemas.scenario_robot import Rod
from surefoot.sim_robot.conventions import SIM_STEP_S
from surefoot.sim_robot.errors import ScenarioError
from surefoot.sim_robot.rods import Rods
from surefoot.sim_robot.world import World

MAX_FORCE_N = 2000.0
MAX_DURATION_S = 5.0
_ALONG = 1e-9
"""An edge less than so much across a direction is along it."""


class CaptureLimit:
    """The hardest blow that a robot at rest can catch without a step.

    A blow gives the centre of mass a speed of impulse over mass; its capture point, for
    a pendulum of the height of the centre of mass, is that over sqrt(g / height) away.
    It can be caught while that is within the soles' convex hull.
    """

    def __init__(self, robot: Robot, world: World, data: mujoco.MjData) -> None:
        """Take the stance of the moment.

        Args:
            robot: sizes of its soles.
            world: the robot in it.
            data: at rest.
        """
        com = data.subtree_com[world.base_body].copy()
        corners = [
            data.xpos[body]
            + data.xmat[body].reshape(3, 3)
            @ (along * foot.half_length_m, across * foot.half_width_m, 0.0)
            for body, foot in zip(
                world.sole_bodies, (robot.left, robot.right), strict=True
            )
            for along, across in itertools.product((-1.0, 1.0), repeat=2)
        ]
        height = com[2] - np.mean(corners, axis=0)[2]
        self._corners = np.array(corners)[:, :2]
        self._com, self._yaw = com[:2], world.start.yaw
        mass = world.weight / world.gravity
        self._per_metre = mass * math.sqrt(world.gravity / height)

    def force(self, push: Push) -> Vec3:
        """Return the force of a push in world axes, (3,) [N]."""
        if push.force_n is not None:
            return np.array(push.force_n)
        assert push.impulse_share is not None
        angle = self._yaw + math.radians(push.direction_deg or 0.0)
        direction = np.array([math.cos(angle), math.sin(angle)])
        size = push.impulse_share * self.impulse(direction) / push.duration_s
        return np.array([*(size * direction), 0.0])

    def impulse(self, direction: Array) -> float:
        """Return the hardest blow [N s] along a direction, (2,) of length 1."""
        from scipy.spatial import ConvexHull

        hull = ConvexHull(self._corners).equations
        normals, offsets = hull[:, :2], hull[:, 2]
        towards = normals @ direction
        ahead = towards > _ALONG
        room = -(normals @ self._com + offsets)[ahead] / towards[ahead]
        return self._per_metre * max(0.0, float(room.min()))


class Pushes:
    """Applies the scenario's pushes at the centres of mass, in world axes.

    A push acts on whole simulation steps; pushes that overlap add up.

    Attributes:
        rods: of the scenario, at work.
    """

    def __init__(
        self,
        pushes: list[Push],
        world: World,
        *,
        rods: list[Rod] | None = None,
        capture: CaptureLimit,
    ) -> None:
        """Look up the bodies.

        Args:
            pushes: of the scenario.
            world: with the robot.
            rods: of the scenario; their forces are added.
            capture: how hard a blow the soles can catch.

        Raises:
            ScenarioError: a body does not exist or has no mass.
        """
        self._windows: list[tuple[int, int, int, Vec3]] = []
        self._bodies: list[int] = []
        self._valid = valid = _bodies_with_mass(world)
        for index, push in enumerate(pushes):
            if push.body is not None and push.body not in valid:
                near = difflib.get_close_matches(push.body, valid, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ScenarioError(
                    f"push[{index}].body: got {push.body!r}, expected one of "
                    f"{', '.join(valid)}{hint}",
                    field=f"push[{index}].body",
                )
            first = round(push.start_s / SIM_STEP_S)
            last = round((push.start_s + push.duration_s) / SIM_STEP_S)
            body = world.base_body if push.body is None else valid[push.body]
            force = capture.force(push)
            self._windows.append((first, last, body, force))
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
