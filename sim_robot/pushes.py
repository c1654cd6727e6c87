"""External forces on links: timed pushes, and rods that follow, lead or strike them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.messages import PushRequest
from surefoot.schemas.motions import RampMotion, SineMotion
from surefoot.schemas.scenario import Push
from surefoot.schemas.scenario_robot import DisplacementRod, ForceRod, Rod, StrikeRod
from surefoot.schemas.validation import nearest
from surefoot.sim_robot.catalogue import ScenarioError, within
from surefoot.sim_robot.conventions import SIM_STEP_S, MotionLaw
from surefoot.sim_robot.motion import motion_law
from surefoot.sim_robot.world import World

MAX_FORCE_N = 2000.0
MAX_DURATION_S = 5.0
_LEAST_HEIGHT_M = 0.01
_ALONG = 1e-9
"""Edges with a smaller component across a direction count as parallel to it."""
STEADY = 0.3
"""Largest share of a link's momentum that springs and dampers may change in a step."""


class CaptureLimit:
    """The largest impulse that a robot at rest can absorb without a step.

    An impulse gives the centre of mass the speed impulse / mass. The capture point of a
    pendulum as high as the centre of mass is that speed over sqrt(g / height) away. The
    robot can absorb the impulse while the point is in the soles' convex hull.
    """

    def __init__(self, robot: Robot, world: World, data: mujoco.MjData) -> None:
        """Take the robot's present stance."""
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
        # A payload far aside has toppled the robot: it absorbs nothing.
        height = max(_LEAST_HEIGHT_M, com[2] - np.mean(corners, axis=0)[2])
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
        """Return the largest impulse [N s] along a unit direction, (2,)."""
        from scipy.spatial import ConvexHull

        hull = ConvexHull(self._corners).equations
        normals, offsets = hull[:, :2], hull[:, 2]
        towards = normals @ direction
        ahead = towards > _ALONG
        room = -(normals @ self._com + offsets)[ahead] / towards[ahead]
        return self._per_metre * max(0.0, float(room.min()))


class Pushes:
    """Applies the scenario's pushes at the links' centres of mass, in world axes.

    A push acts over whole simulation steps; overlapping pushes add up.
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

        Raises:
            ScenarioError: a body does not exist or has no mass, or a push is shorter
                than a step of the simulation.
        """
        self._windows: list[tuple[int, int, int, Vec3]] = []
        self._bodies: list[int] = []
        self._valid = valid = _bodies_with_mass(world)
        for index, push in enumerate(pushes):
            first = round(push.start_s / SIM_STEP_S)
            last = round((push.start_s + push.duration_s) / SIM_STEP_S)
            body = world.base_body
            if push.body is not None:
                body = _find(push.body, valid, key=f"push[{index}].body")
            if push.duration_s < SIM_STEP_S:
                raise ScenarioError(
                    f"push[{index}].duration_s: got {push.duration_s:g} s, expected "
                    f"{SIM_STEP_S:g} s or more, a step of the simulation",
                    field=f"push[{index}].duration_s",
                )
            force = capture.force(push)
            self._windows.append((first, last, body, force))
            self._bodies.append(body)
        self.rods = Rods(rods or [], world.model, valid)
        self._bodies += [rod.body for rod in self.rods.at_work]

    def add(self, push: PushRequest, *, first_step: int) -> None:
        """Add a push that is requested during the run.

        Raises:
            ScenarioError: the body does not exist or has no mass, or the push is
                implausibly strong, short or long.
        """
        body = _find(push.body, self._valid, key="body")
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
        last = first_step + round(push.duration_s / SIM_STEP_S)
        self._windows.append((first_step, last, body, np.array(push.force_n)))
        self._bodies.append(body)

    def apply(self, data: mujoco.MjData, step: int) -> None:
        """Set the forces of simulation step ``step``, counted from zero."""
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


def _find(name: str, bodies: dict[str, int], *, key: str) -> int:
    """Return MuJoCo's id of a link with mass.

    Raises:
        ScenarioError: no link has this name; ``field`` is the key.
    """
    if name not in bodies:
        raise ScenarioError(
            f"{key}: got {name!r}, expected one of {', '.join(bodies)}"
            f"{nearest(name, bodies)}",
            field=key,
        )
    return bodies[name]


class RodState(NamedTuple):
    """A rod after the last simulation step.

    Attributes:
        force_n: force on the link, along the rod [N].
        position_m: position of the link along the rod, from its start [m].
        work_j: work that the rod has done on the robot [J].
        impulse_n_s: impulse that it has given [N s].
        peak_n: largest force, without its sign [N].
    """

    force_n: float = 0.0
    position_m: float = 0.0
    work_j: float = 0.0
    impulse_n_s: float = 0.0
    peak_n: float = 0.0


RodLaw = Callable[[float, float, float], float]
"""Maps the time since the rod began [s], and position from then [m] and speed [m/s] of
its link, to the force on the link [N]; called once per step."""


class RodAtWork:
    """One rod of a scenario in action.

    Attributes:
        body: MuJoCo's id of the link.
        direction: (3,) unit vector along the rod, world.
        state: state after the last step.
    """

    def __init__(self, rod: Rod, body: int, *, mass: float) -> None:
        """Prepare the rod for a link, MuJoCo's ``body``, of a mass [kg].

        Raises:
            ScenarioError: the rod is too stiff for so light a link, or too fast.
        """
        angle = math.radians(rod.direction_deg)
        self.body = body
        self.direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        self.state = RodState()
        self._law = _law(rod)
        self._first_step = round(rod.start_s / SIM_STEP_S)
        self._origin: float | None = None
        self._last = self._moved = 0.0
        _check_steady(rod, mass)

    def step(self, place: float, step: int) -> float:
        """Return the force on the link in a simulation step, along the rod [N].

        Args:
            place: position of the link's centre of mass along the rod [m].
            step: simulation step, counted from zero.
        """
        if step < self._first_step:
            return 0.0
        if self._origin is None:
            self._origin = self._last = place
        position, moved = place - self._origin, place - self._last
        self._last = place
        since_s = (step - self._first_step) * SIM_STEP_S
        before = self.state
        force = self._law(since_s, position, moved / SIM_STEP_S)
        self.state = RodState(
            force_n=force,
            position_m=position,
            # The force of the step before changed the speed from that of the last move
            # to that of this one.
            work_j=before.work_j + before.force_n * 0.5 * (self._moved + moved),
            impulse_n_s=before.impulse_n_s + force * SIM_STEP_S,
            peak_n=max(before.peak_n, abs(force)),
        )
        self._moved = moved
        return force


class Rods:
    """All rods of a scenario."""

    def __init__(
        self, rods: list[Rod], model: mujoco.MjModel, bodies: dict[str, int]
    ) -> None:
        """Look up the links.

        Raises:
            ScenarioError: a link does not exist, or a rod does not fit it.
        """
        self.at_work: list[RodAtWork] = []
        for index, rod in enumerate(rods):
            body = _find(rod.body, bodies, key=f"rod[{index}].body")
            mass = float(model.body_mass[body])
            with within(f"rod[{index}]"):
                self.at_work.append(RodAtWork(rod, body, mass=mass))

    def apply(self, data: mujoco.MjData, step: int) -> None:
        """Add the forces of simulation step ``step``, counted from zero."""
        for rod in self.at_work:
            place = float(data.xipos[rod.body] @ rod.direction)
            force = rod.step(place, step)
            data.xfrc_applied[rod.body, :3] += force * rod.direction


def _law(rod: Rod) -> RodLaw:
    if isinstance(rod, StrikeRod):
        return _strike(rod)
    if isinstance(rod, ForceRod):
        push = _course(rod, rod.amplitude_n)
        return lambda since_s, position, speed: push(since_s)[0]
    course = _course(rod, rod.amplitude_m)
    stiffness, damping = rod.stiffness_n_m, rod.damping_n_s_m

    def lead(since_s: float, position: float, speed: float) -> float:
        aim, aim_speed = course(since_s)
        return stiffness * (aim - position) + damping * (aim_speed - speed)

    return lead


def _strike(rod: StrikeRod) -> RodLaw:
    """Make the law of a padded mass that strikes until it flies off."""
    place, own_speed, is_over = 0.0, rod.speed_m_s, False

    def law(since_s: float, position: float, speed: float) -> float:
        nonlocal place, own_speed, is_over
        del since_s
        if is_over:
            return 0.0
        pressed = place - position
        is_over = pressed < 0.0 and own_speed < speed
        force = rod.stiffness_n_m * max(pressed, 0.0)
        own_speed -= force / rod.mass_kg * SIM_STEP_S
        place += own_speed * SIM_STEP_S
        return force

    return law


def _course(rod: ForceRod | DisplacementRod, amplitude: float) -> MotionLaw:
    """Return the course of a force or a displacement, by the ground's laws."""
    frequency_hz = rod.frequency_hz
    if frequency_hz is not None:
        return motion_law(
            SineMotion(axis="x", amplitude_m=amplitude, frequency_hz=frequency_hz)
        )
    assert rod.rise_s is not None
    # It speeds up for half of the time and slows down for the other half.
    ramp = RampMotion(
        axis="x",
        amplitude_m=amplitude,
        rate_m_s=2.0 * amplitude / rod.rise_s,
        blend_s=0.5 * rod.rise_s,
    )
    return motion_law(ramp)


def _check_steady(rod: Rod, mass: float) -> None:
    """Refuse springs and dampers that would overshoot in a step of the simulation."""
    if isinstance(rod, ForceRod):
        return
    share = rod.stiffness_n_m * SIM_STEP_S**2 / mass
    if isinstance(rod, DisplacementRod):
        share += rod.damping_n_s_m * SIM_STEP_S / mass
    if share > STEADY:
        raise ScenarioError(
            f"stiffness_n_m: got {rod.stiffness_n_m:g} N/m against {rod.body!r} of "
            f"{mass:.3g} kg, expected a rod that is less stiff for a link so light; "
            "lower stiffness_n_m and damping_n_s_m, or name a heavier link",
            field="stiffness_n_m",
        )
