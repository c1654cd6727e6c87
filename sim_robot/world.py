"""Builds the world in MuJoCo: robot, ground, payloads and scenery."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Vec3
from surefoot.schemas.robot_file import Foot
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_robot import Payload
from surefoot.schemas.validation import nearest
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.conventions import SIM_STEP_S
from surefoot.sim_robot.ground import PlatformPlan, add_platform, plan_platforms
from surefoot.sim_robot.robot_spec import (
    ANKLES,
    UNITS,
    Stance,
    refusing,
    robot_spec,
    stand,
)
from surefoot.sim_robot.still_ground import (
    StillGround,
    add_scenery,
    add_still_ground,
    plan_still_ground,
    rise_under,
    soften,
)

DENSITY_KG_M3 = 2000.0
NOT_YET_KG = 1e-6
"""Mass of a load until it is grasped."""
_PREFIX = "payload_"
TANGENTIAL_STIFFNESS_RATIO = 10.0
"""Stiffness of friction over that of the normal contact, so that soles do not creep."""
SOLVER_TOLERANCE = 1e-10


def add_payloads(
    spec: mujoco.MjSpec, robot: Robot, payloads: Sequence[Payload]
) -> None:
    """Fix a ball to each link that carries one.

    Raises:
        ScenarioError: a payload's link does not exist.
    """
    links = [body.name for body in spec.bodies if body.name != "world"]
    for index, load in enumerate(payloads):
        if load.link not in links:
            raise ScenarioError(
                f"payload[{index}].link: {robot.file.name} has no link {load.link!r}"
                f"{nearest(load.link, links)}; there are {', '.join(links)}",
                field=f"payload[{index}].link",
            )
        mass = load.mass_kg if load.start_s == 0.0 else NOT_YET_KG
        ball = spec.body(load.link).add_body(
            name=f"{_PREFIX}{index}",
            pos=load.offset_m,
            mass=mass,
            ipos=[0.0, 0.0, 0.0],
            inertia=[_inertia(mass)] * 3,
            explicitinertial=True,
        )
        ball.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[_radius(load.mass_kg), 0.0, 0.0],
            mass=0.0,
            contype=0,
            conaffinity=0,
            rgba=[0.85, 0.45, 0.15, 1.0],
        )


def is_payload(name: str) -> bool:
    """Return whether a body is a load and not part of the robot."""
    return name.startswith(_PREFIX)


class _Grasp(NamedTuple):
    """A load to come: simulation step of its grasp, body, mass [kg]."""

    step: int
    body: int
    mass: float


class Grasps:
    """Gives loads their mass at their time."""

    def __init__(
        self,
        payloads: Sequence[Payload],
        model: mujoco.MjModel,
        *,
        renew: Callable[[mujoco.MjModel], None],
    ) -> None:
        """Find the loads that are not carried from the start."""
        self._model, self._renew = model, renew
        self._coming = [
            _Grasp(
                round(load.start_s / SIM_STEP_S),
                int(model.body(f"{_PREFIX}{index}").id),
                load.mass_kg,
            )
            for index, load in enumerate(payloads)
            if load.start_s > 0.0
        ]

    def apply(self, step: int) -> None:
        """Grasp loads that are due in simulation step ``step``, counted from zero."""
        if not self._coming:
            return
        due = [grasp for grasp in self._coming if grasp.step <= step]
        if not due:
            return
        self._coming = [grasp for grasp in self._coming if grasp.step > step]
        for grasp in due:
            self._model.body_mass[grasp.body] = grasp.mass
            self._model.body_inertia[grasp.body] = np.full(3, _inertia(grasp.mass))
        self._renew(self._model)


def _radius(mass_kg: float) -> float:
    return float((3.0 * mass_kg / (4.0 * math.pi * DENSITY_KG_M3)) ** (1.0 / 3.0))


def _inertia(mass_kg: float) -> float:
    """Return the inertia of a solid ball about its centre [kg m^2]."""
    return 0.4 * mass_kg * _radius(mass_kg) ** 2


@dataclass(frozen=True)
class World:
    """A compiled world and the places of its parts in MuJoCo's arrays.

    Attributes:
        model: MuJoCo model. Actuators are in bus order. The robot's degrees of freedom
            come first, then the platforms', then the seesaws'.
        platforms: ground that may move, in the order of ``ground_bodies``.
        still: ground without a prescribed motion: tiles, and the floor around them.
        nominal: the nominal stance, at the place where the robot begins.
        start: the stance in which it begins; mostly the nominal one.
        rise: rise of the robot's start above level ground, for what is under it [m].
        base_up: (3,) upward direction in the nominal posture, in the base link.
        base_body: id of the base link.
        sensor_sites: ids of the sensor frames, by channel.
        joint_qpos: (n_a,) addresses in qpos, bus order.
        joint_dof: (n_a,) addresses in qvel, bus order.
        sole_bodies: ids of left and right sole.
        ground_bodies: ids of the platforms.
        seesaws: ids of the tiles that tip, in order.
        upper_bodies: ids of the robot's bodies above the ankles. They touch the ground
            only in a fall.
        weight: the robot's true weight [N].
        gravity: magnitude of gravity [m/s^2].
    """

    model: mujoco.MjModel
    platforms: tuple[PlatformPlan, ...]
    still: tuple[StillGround, ...]
    nominal: Stance
    start: Stance
    rise: float
    base_up: Vec3
    base_body: int
    sensor_sites: dict[str, int]
    joint_qpos: NDArray[np.intp]
    joint_dof: NDArray[np.intp]
    sole_bodies: tuple[int, int]
    ground_bodies: tuple[int, ...]
    seesaws: tuple[int, ...]
    upper_bodies: NDArray[np.intp]
    weight: float
    gravity: float


def build_world(robot: Robot, scenario: Scenario, *, scenery: bool = False) -> World:
    """Build the world of one run.

    Returns:
        The world; it contains no state.

    Raises:
        RobotFileError: MuJoCo refuses the robot.
        ScenarioError: the scenario does not fit the robot.
    """
    with refusing(robot):
        spec = robot_spec(robot, scenario, visuals=scenery)
        nominal, start = stand(spec, robot, scenario.start)
        add_payloads(spec, robot, scenario.payload)
    platforms = plan_platforms(scenario, start)
    for plan in platforms:
        add_platform(spec, plan, robot=robot, friction=scenario.friction)
    still = plan_still_ground(scenario)
    for ground in still:
        add_still_ground(spec, ground, robot=robot)
    _set_options(spec, gravity=scenario.model_error.gravity_m_s2)
    if scenery:
        add_scenery(spec, platforms)
    with refusing(robot):
        model = spec.compile()
    _scale_masses(model, robot, scale=scenario.model_error.mass_scale)
    base_body = _body_id(model, robot.file.base_link)
    _forget_platform_inertia(model, robot)
    soften(model, still, robot=robot)
    gravity = scenario.model_error.gravity_m_s2
    joints = [model.joint(name) for name in robot.joint_names]
    feet = (robot.left, robot.right)
    return World(
        model=model,
        platforms=platforms,
        still=still,
        nominal=nominal,
        start=start,
        rise=rise_under(still, start, robot=robot),
        base_up=robot.R_upright_base[2].copy(),
        base_body=base_body,
        sensor_sites={
            entry.name: int(model.site(entry.name).id) for entry in (*UNITS, *ANKLES)
        },
        joint_qpos=np.array([j.qposadr[0] for j in joints], dtype=np.intp),
        joint_dof=np.array([j.dofadr[0] for j in joints], dtype=np.intp),
        sole_bodies=(
            _body_id(model, robot.left.sole_frame),
            _body_id(model, robot.right.sole_frame),
        ),
        ground_bodies=tuple(_body_id(model, plan.name) for plan in platforms),
        seesaws=tuple(_body_id(model, tile.name) for tile in still if tile.tip_rad),
        upper_bodies=_upper_bodies(model, base_body, feet=feet),
        weight=float(model.body_subtreemass[base_body]) * gravity,
        gravity=gravity,
    )


def _set_options(spec: mujoco.MjSpec, *, gravity: float) -> None:
    option = spec.option
    option.timestep = SIM_STEP_S
    option.gravity = [0.0, 0.0, -gravity]
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    # At the default 1e-8 the solver stops early, with tangential forces 1 % off.
    option.tolerance = SOLVER_TOLERANCE
    option.impratio = TANGENTIAL_STIFFNESS_RATIO
    # A state that blew up is a fall to report, not something to reset silently.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET


def _scale_masses(model: mujoco.MjModel, robot: Robot, *, scale: float) -> None:
    """Scale the mass of every link of the robot; rotor inertias stay."""
    if scale == 1.0:
        return
    base = _body_id(model, robot.file.base_link)
    links = [
        body
        for body in np.flatnonzero(model.body_rootid == base)
        if not is_payload(model.body(body).name)
    ]
    model.body_mass[links] *= scale
    model.body_inertia[links] *= scale
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _forget_platform_inertia(model: mujoco.MjModel, robot: Robot) -> None:
    """Make the solver's tolerance relative to the robot's mean inertia alone."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    model.stat.meaninertia = float(np.mean(np.diag(inertia)[: 6 + robot.n_a]))


def _upper_bodies(
    model: mujoco.MjModel, base_body: int, *, feet: tuple[Foot, Foot]
) -> NDArray[np.intp]:
    """Return the robot's bodies without the feet and all bodies that hang on them.

    A foot begins at the two joints above its sole, those of an ankle. Toes, covers and
    frames beside the sole belong to it.
    """
    low: set[int] = set()
    for foot in feet:
        body = _body_id(model, foot.sole_frame)
        moved = 0
        while moved < 2 and body != base_body:
            top = body
            moved += int(model.body_jntnum[body])
            body = int(model.body_parentid[body])
        low.add(top)
    links = np.flatnonzero(model.body_rootid == base_body).tolist()
    for link in links:  # parents come before their children
        if int(model.body_parentid[link]) in low:
            low.add(link)
    upper = [
        link
        for link in links
        if link not in low
        and model.body_mass[link] > 0.0  # a frame touches nothing
        and not is_payload(model.body(link).name)
    ]
    return np.array(upper, dtype=np.intp)


def renew(model: mujoco.MjModel, world: World, robot: Robot) -> None:
    """Recompute everything that depends on the masses of the model."""
    mujoco.mj_setConst(model, mujoco.MjData(model))
    _forget_platform_inertia(model, robot)
    soften(model, world.still, robot=robot)


def _body_id(model: mujoco.MjModel, name: str) -> int:
    return int(model.body(name).id)
