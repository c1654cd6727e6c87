"""Ground without a prescribed motion: floor, tiles and seesaws, and all scenery."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import mujoco
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Mat, Vec3
from surefoot.schemas.scenario import Scenario, Tile
from surefoot.sim_robot.conventions import SIM_STEP_S
from surefoot.sim_robot.ground import BEYOND_WALK_M, PlatformPlan, let_soles_touch
from surefoot.sim_robot.robot_spec import Stance

FLOOR_Z_M = -0.42
"""Height of the scenery's floor [m], well below the ground of any scenario."""
_SHADOW_PIXELS = 8192
_MAT_RIM_M = 0.025
_MAT_HALF_THICKNESS_M = 0.0005
Extent = tuple[float, float]
Extents = tuple[Extent, Extent]
FLOOR_M: Extents = ((-3.0, 12.0), (-6.0, 6.0))
"""Least extent of the floor along x and along y [m]."""
FLOOR_THICKNESS_M = 0.06
SAME_EDGE_M = 1e-6
"""Edges of tiles nearer than this are one: no floor lies between touching tiles [m]."""
BELOW_M = 0.3
"""Depth by which the block of a tile reaches below the floor, and its own top [m]."""
SEESAW_THICKNESS_M = 0.05
SEESAW_KG_M3 = 700.0
"""Density of a seesaw, of wood."""
SEESAW_DAMPING = 1.0
"""Damping of a seesaw's bearing [N m s/rad]."""
STOP_TIME_CONSTANT_S = 0.01
"""Time constant of a seesaw's stops."""
CORNERS = 4
"""Number of contact points of a sole that lies flat."""


_SEEN_M = 2.0
"""Size of what is looked at, however far the ground reaches: shadows are as sharp as
this is small [m]."""


def add_scenery(spec: mujoco.MjSpec, platforms: tuple[PlatformPlan, ...]) -> None:
    """Add lights, a sky, a floor that nothing touches, and mats on the platforms."""
    _add_sky_and_floor(spec)
    for plan in platforms:
        _add_mat(spec, plan)
    _add_lights(spec)
    spec.visual.quality.shadowsize = _SHADOW_PIXELS
    spec.visual.quality.offsamples = 8
    spec.visual.map.zfar = 60.0
    spec.visual.map.znear = 0.02
    spec.visual.map.haze = 0.25
    spec.visual.rgba.haze = [0.93, 0.95, 0.97, 1.0]
    spec.visual.map.shadowclip = 1.6


def _add_sky_and_floor(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.62, 0.70, 0.80],
        width=512,
        height=3072,
    )
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.88, 0.90, 0.93],
        rgb2=[0.84, 0.86, 0.89],
        mark=mujoco.mjtMark.mjMARK_EDGE,
        markrgb=[0.76, 0.79, 0.83],
        width=512,
        height=512,
    )
    floor = spec.add_material(name="floor", texrepeat=[1.0, 1.0], texuniform=True)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],  # endless
        pos=[0.0, 0.0, FLOOR_Z_M],
        contype=0,
        conaffinity=0,
        material="floor",
    )


def _add_mat(spec: mujoco.MjSpec, plan: PlatformPlan) -> None:
    """Add a lighter top face inside the platform's rim, to show its attitude."""
    size = plan.half_size - _MAT_RIM_M
    size[2] = _MAT_HALF_THICKNESS_M
    mat = spec.body(plan.name).add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=size,
        pos=plan.box_centre * [1.0, 1.0, 0.0],
        quat=plan.quat_wxyz,
        contype=0,
        conaffinity=0,
        group=1,
        rgba=[0.66, 0.70, 0.75, 1.0],
    )
    if plan.half_size[:2].min() > _SEEN_M:  # squares show that the robot walks
        spec.stat.extent = _SEEN_M
        mat.material = "floor"
        mat.rgba = [0.5, 0.5, 0.5, 1.0]  # MuJoCo's own: the material's colour counts


def _add_lights(spec: mujoco.MjSpec) -> None:
    head = spec.visual.headlight
    head.ambient = [0.30, 0.31, 0.33]
    head.diffuse = [0.14, 0.14, 0.15]
    head.specular = [0.05, 0.05, 0.05]
    spec.worldbody.add_light(
        name="key",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[1.5, -2.0, 4.0],
        dir=[-0.75, 0.30, -1.0],
        diffuse=[0.52, 0.51, 0.49],
        specular=[0.25, 0.25, 0.25],
        castshadow=True,
    )
    spec.worldbody.add_light(
        name="fill",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[2.0, 3.0, 3.0],
        dir=[-0.6, -0.8, -0.6],
        diffuse=[0.12, 0.14, 0.17],
        castshadow=False,
    )


@dataclass(frozen=True)
class StillGround:
    """A block of ground with a top for the soles.

    Attributes:
        name: ``tile_0`` and so on, or ``floor_0`` and so on.
        top_centre: (3,) middle of the top [m, world].
        R_world_top: (3, 3) attitude of the top, world from block.
        size: (3,) size along its own axes [m].
        friction: friction coefficient of the soles on it.
        stiffness_n_m: stiffness under a whole sole [N/m]; None for firm ground.
        damping_n_s_m: damping under it [N s/m]; None for half of critical damping.
        tip_rad: largest angle of a seesaw about its middle, either way [rad]; 0 for a
            block that stands still.
        tip_axis: axis of the seesaw: its own x (roll) or y (pitch).
    """

    name: str
    top_centre: Vec3
    R_world_top: Mat
    size: Vec3
    friction: float
    stiffness_n_m: float | None = None
    damping_n_s_m: float | None = None
    tip_rad: float = 0.0
    tip_axis: str = "pitch"

    @property
    def quat_wxyz(self) -> list[float]:
        """(4,) attitude, world from block, at rest."""
        from scipy.spatial.transform import Rotation

        x, y, z, w = Rotation.from_matrix(self.R_world_top).as_quat().tolist()
        return [w, x, y, z]

    def height_at(self, x: float, y: float) -> float | None:
        """Return the height of the top at a place; None beside the block [m]."""
        normal = self.R_world_top[:, 2]
        dx, dy = x - self.top_centre[0], y - self.top_centre[1]
        dz = -(normal[0] * dx + normal[1] * dy) / normal[2]
        place = self.R_world_top.T @ (dx, dy, dz)
        if (np.abs(place[:2]) > 0.5 * self.size[:2]).any():
            return None
        return float(self.top_centre[2] + dz)


def plan_still_ground(scenario: Scenario) -> tuple[StillGround, ...]:
    """Lay out the tiles, and the floor around them.

    Args:
        scenario: has the tiles. Without tiles there is no such ground; with platforms
            there is no floor.
    """
    tiles = tuple(
        _tile(index, tile, friction=scenario.friction)
        for index, tile in enumerate(scenario.tile)
    )
    if not tiles or scenario.platform:
        return tiles
    return (*tiles, *_floor(tiles, scenario))


def add_still_ground(spec: mujoco.MjSpec, ground: StillGround, *, robot: Robot) -> None:
    """Add a block that only the soles touch; a seesaw is a body with its name."""
    is_tile = ground.name.startswith("tile")
    parent = spec.worldbody
    place, quat_wxyz = ground.top_centre, ground.quat_wxyz
    down = -0.5 * ground.size[2] * ground.R_world_top[:, 2]
    if ground.tip_rad:
        parent = _add_seesaw(spec, ground)
        place, quat_wxyz = np.zeros(3), [1.0, 0.0, 0.0, 0.0]
        down = np.array([0.0, 0.0, -0.5 * ground.size[2]])
    parent.add_geom(
        name=ground.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=0.5 * ground.size,
        pos=place + down,
        quat=quat_wxyz,
        contype=0,
        conaffinity=0,
        density=SEESAW_KG_M3,
        rgba=[0.66, 0.70, 0.75, 1.0] if is_tile else [0.80, 0.82, 0.85, 1.0],
    )
    let_soles_touch(spec, ground.name, robot=robot, friction=ground.friction)


def _add_seesaw(spec: mujoco.MjSpec, ground: StillGround) -> mujoco.MjsBody:
    """Add a body that turns about the middle of its top, free of gravity."""
    body = spec.worldbody.add_body(
        name=ground.name, pos=ground.top_centre, quat=ground.quat_wxyz, gravcomp=1.0
    )
    joint = body.add_joint(
        name=ground.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[1.0, 0.0, 0.0] if ground.tip_axis == "roll" else [0.0, 1.0, 0.0],
        limited=True,
        range=[-ground.tip_rad, ground.tip_rad],
    )
    joint.damping[0] = SEESAW_DAMPING
    joint.solref_limit[:] = [STOP_TIME_CONSTANT_S, 1.0]
    return body


def rise_under(
    grounds: tuple[StillGround, ...], start: Stance, *, robot: Robot
) -> float:
    """Return the rise of the starting pose that clears the ground below it [m]."""
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    soles = start.soles_in_world
    heights = [
        height
        for sole, foot in zip(soles, (robot.left, robot.right), strict=True)
        for along, across in itertools.product((-1.0, 0.0, 1.0), repeat=2)
        for ground in grounds
        if (
            height := ground.height_at(
                sole[0]
                + cos * along * foot.half_length_m
                - sin * across * foot.half_width_m,
                sole[1]
                + sin * along * foot.half_length_m
                + cos * across * foot.half_width_m,
            )
        )
        is not None
    ]
    return max(heights, default=0.0)


def soften(
    model: mujoco.MjModel, grounds: tuple[StillGround, ...], *, robot: Robot
) -> None:
    """Give soft ground its stiffness and damping [N/m, N s/m].

    MuJoCo's contact solves J a + R f = a_ref. Here a_ref = -b v - k r at depth r and,
    for an impedance d, R = (1 - d) / (d m), where 1 / m is MuJoCo's estimate of the
    acceleration by a unit force. With k = K R and b = C R that is a force of K r + C v
    and a mass 1 / R that moves along. The impedance makes this mass as small as the
    simulation's steps keep stable. The corners of a sole share all of it.
    """
    half_mass = 0.5 * float(model.body(robot.file.base_link).subtreemass[0])
    for ground in grounds:
        if ground.stiffness_n_m is None:
            continue
        stiffness, damping = ground.stiffness_n_m, ground.damping_n_s_m
        if damping is None:
            damping = math.sqrt(stiffness * half_mass)
        mass = max(damping * SIM_STEP_S, stiffness * SIM_STEP_S**2)
        for foot in (robot.left, robot.right):
            pair = model.pair(f"{ground.name} {foot.sole_frame}")
            moved = float(model.body(foot.sole_frame).invweight0[0])
            impedance = 1.0 / (1.0 + CORNERS / (mass * moved))
            # R = CORNERS / mass, and K and C are those of one corner. A negative
            # solref contains -k d^2 and -b d; k d r is what acts at depth r.
            pair.solref[:] = (
                -stiffness / mass * impedance,
                -damping / mass * impedance,
            )
            pair.solimp[:] = (impedance, impedance, 0.001, 0.5, 2.0)


def _tile(index: int, tile: Tile, *, friction: float) -> StillGround:
    from scipy.spatial.transform import Rotation

    angles = [tile.pitch_deg, tile.roll_deg]
    thickness = BELOW_M + max(tile.height_m, 0.0)
    if tile.tip_deg:
        thickness = SEESAW_THICKNESS_M
    return StillGround(
        name=f"tile_{index}",
        top_centre=np.array([*tile.center_m, tile.height_m]),
        R_world_top=Rotation.from_euler("YX", angles, degrees=True).as_matrix(),
        size=np.array([*tile.size_m, thickness]),
        friction=friction if tile.friction is None else tile.friction,
        stiffness_n_m=tile.stiffness_n_m,
        damping_n_s_m=tile.damping_n_s_m,
        tip_rad=math.radians(tile.tip_deg),
        tip_axis=tile.tip_axis,
    )


def _floor(
    tiles: tuple[StillGround, ...], scenario: Scenario
) -> tuple[StillGround, ...]:
    """Return the floor without the tiles' footprints, as few rectangles along rows."""
    floor, walk = FLOOR_M, scenario.walk
    if walk is not None:
        far = walk.reach_m(scenario.duration_s) + BEYOND_WALK_M
        leaves = walk.velocity_m_s < 0.0 or walk.yaw_rate_deg_s != 0.0
        if leaves or far > floor[0][1]:
            floor = ((-far, max(far, floor[0][1])), (-far, far))
    xs, ys = (_edges(tiles, axis, floor) for axis in (0, 1))
    boxes: list[list[float]] = []  # x from, x to, y from, y to
    for x, x_next in itertools.pairwise(xs):
        strips: list[list[float]] = []
        for y, y_next in itertools.pairwise(ys):
            middle = 0.5 * (x + x_next), 0.5 * (y + y_next)
            if any(_covers(tile, *middle, floor) for tile in tiles):
                continue
            if strips and strips[-1][3] == y:
                strips[-1][3] = y_next
            else:
                strips.append([x, x_next, y, y_next])
        for strip in strips:
            same = [b for b in boxes if b[1] == x and b[2:] == strip[2:]]
            if same:
                same[0][1] = x_next
            else:
                boxes.append(strip)
    return tuple(
        StillGround(
            name=f"floor_{index}",
            top_centre=np.array([0.5 * (x + x_to), 0.5 * (y + y_to), 0.0]),
            R_world_top=np.eye(3),
            size=np.array([x_to - x, y_to - y, FLOOR_THICKNESS_M]),
            friction=scenario.friction,
        )
        for index, (x, x_to, y, y_to) in enumerate(boxes)
    )


def _edges(tiles: tuple[StillGround, ...], axis: int, floor: Extents) -> list[float]:
    """Return where floor may begin and end along an axis, each place once [m]."""
    found: list[float] = []
    for edge in sorted(
        {*floor[axis], *(e for tile in tiles for e in _extent(tile, axis, floor))}
    ):
        if not found or edge - found[-1] > SAME_EDGE_M:
            found.append(edge)
    return found


def _extent(tile: StillGround, axis: int, floor: Extents) -> Extent:
    """Return a tile's extent along an axis, cut to the floor [m]."""
    centre, half = float(tile.top_centre[axis]), 0.5 * float(tile.size[axis])
    low, high = floor[axis]
    return min(max(centre - half, low), high), min(max(centre + half, low), high)


def _covers(tile: StillGround, x: float, y: float, floor: Extents) -> bool:
    within_x, within_y = _extent(tile, 0, floor), _extent(tile, 1, floor)
    return within_x[0] < x < within_x[1] and within_y[0] < y < within_y[1]
