"""Light, sky and floor: what pictures need and the simulation does not."""

from __future__ import annotations

import mujoco

from surefoot.sim_robot.platforms import PlatformPlan

FLOOR_Z_M = -0.42
"""The floor is scenery, well below where the ground of any scenario goes."""
_SHADOW_PIXELS = 8192
_MAT_RIM_M = 0.025
_MAT_HALF_THICKNESS_M = 0.0005


def add_scenery(spec: mujoco.MjSpec, platforms: tuple[PlatformPlan, ...]) -> None:
    """Add lights, a sky, a floor that nothing touches, and mats on the platforms.

    Args:
        spec: the world, before it is compiled.
        platforms: the ground in it.
    """
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
    spec.body(plan.name).add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=size,
        pos=plan.box_centre * [1.0, 1.0, 0.0],
        quat=plan.quat_wxyz,
        contype=0,
        conaffinity=0,
        group=1,
        rgba=[0.66, 0.70, 0.75, 1.0],
    )


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
