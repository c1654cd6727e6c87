"""Sway with tilting ground: size, direction, and the limit of the soles."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import SwaySettings
from surefoot.schemas.motions import SineMotion
from surefoot.schemas.settings import ControllerSettings, WalkSettings, build_settings
from surefoot.schemas.toml_file import convert, read_toml
from surefoot.sim_robot.motion import motion_law
from surefoot.stabilizer.control.reference import Stance, standing
from surefoot.stabilizer.factory import PRESETS_DIR
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from surefoot.stabilizer.whole_body.sway import REACH, Sway
from tests.stabilizer.closed_loop import Run, run_closed_loop, swing

DT = 1e-2
"""Period of a robot of 100 Hz, which is faster to test [s]."""
PEOPLE = SwaySettings(gain=3.0, frequency_hz=0.5, damping=0.5, upright_again_s=6.0)
SMALL_RAD, STEEP_RAD = 2e-3, 0.15
SLOW_HZ = 0.2
SMALL_DEG, STEEP_DEG = 0.6, 8.0
SHARE = 0.02
"""Relative difference from the continuous filter that is allowed [1]."""
TRACKED_M = 3e-3
MOST_OF_SOLE = 0.75
"""Bound of the CoM's distance from the middle, as a share of the half length [1].

It covers the reach and a robot that is 8 mm off its reference.
"""


def soles_on(stance: Stance, tilt: Rotation, rate: Array) -> Any:
    """Return two soles on one tilted platform.

    Args:
        stance: places of the feet on level ground.
        tilt: tilt of the platform [rad].
        rate: its angular velocity, world axes [rad/s].
    """
    R = tilt.as_matrix()
    twist = np.concatenate((np.zeros(3), R.T @ rate))
    return SimpleNamespace(
        R_world_sole=[R, R],
        p_sole=[R @ p for p in stance.p_sole],
        v_sole=np.tile(twist, 2),
    )


def turned_stance(model: RobotModel, yaw: float) -> Stance:
    """Return the stance with feet and base turned on the spot."""
    stance = standing(model)
    R = Rotation.from_euler("z", yaw).as_matrix()
    stance.p_sole = [R @ p for p in stance.p_sole]
    stance.yaw_sole = [yaw, yaw]
    return stance


def swaying(
    model: RobotModel,
    *,
    axis: str,
    size_rad: float,
    hz: float = SLOW_HZ,
    yaw: float = 0.0,
    periods: int = 6,
    settings: SwaySettings = PEOPLE,
) -> tuple[Array, Array]:
    """Sway on a platform that swings.

    Returns:
        Tilts (n,) [rad], and (n, 9) additions to the reference's CoM, its velocity and
        its acceleration, world axes.
    """
    sway = Sway(settings, WalkSettings(), half_sizes=model.half_sizes, period_s=DT)
    stance = turned_stance(model, yaw)
    about = np.array([float(axis == "roll"), float(axis == "pitch"), 0.0])
    omega = 2.0 * math.pi * hz
    sway.begin(soles_on(stance, Rotation.identity(), np.zeros(3)), stance)
    tilts, added = [], []
    for tick in range(round(periods / hz / DT)):
        angle = size_rad * math.sin(omega * DT * tick)
        rate = size_rad * omega * math.cos(omega * DT * tick)
        soles = soles_on(stance, Rotation.from_rotvec(angle * about), rate * about)
        sway.step(soles, stance, stands=True)
        before = np.concatenate((stance.com, stance.com_velocity))
        sway.move(stance, 1.0)
        added.append(
            np.concatenate((stance.com, stance.com_velocity, stance.com_acceleration))
        )
        sway.move(stance, -1.0)
        after = np.concatenate((stance.com, stance.com_velocity))
        np.testing.assert_allclose(after, before, atol=1e-12)
        added[-1][:6] -= before
        tilts.append(angle)
    return np.array(tilts), np.array(added)


def response(tilts: Array, way: Array, hz: float) -> complex:
    """Return the part of the sway in phase with the tilt, over the last two periods."""
    n = round(2.0 / hz / DT)
    turn = np.exp(-2j * np.pi * hz * DT * np.arange(n))
    ratio: complex = (way[-n:] @ turn) / (tilts[-n:] @ turn)
    return ratio


def expected(settings: SwaySettings, hz: float) -> complex:
    """Return lean over tilt of the continuous filter, one tick later."""
    s, omega = 2j * math.pi * hz, 2.0 * math.pi * settings.frequency_hz
    follows = 1.0 / (1.0 + 2.0 * settings.damping * s / omega + (s / omega) ** 2)
    forgets = settings.upright_again_s * s
    at_once = settings.gain * follows * forgets / (1.0 + forgets)
    return complex(at_once * np.exp(s * DT))


@pytest.mark.parametrize("hz", [SLOW_HZ, PEOPLE.frequency_hz, 1.0])
@pytest.mark.parametrize(("axis", "along"), [("pitch", (1, 0)), ("roll", (0, -1))])
def test_a_small_tilt_is_followed_by_gain_and_filter(
    model: RobotModel, axis: str, along: tuple[int, int], hz: float
) -> None:
    tilts, added = swaying(model, axis=axis, size_rad=SMALL_RAD, hz=hz)
    lean = added[:, :2] @ along / standing(model).com_nominal
    wanted = expected(PEOPLE, hz)
    assert abs(response(tilts, lean, hz) - wanted) < SHARE * abs(wanted)
    across = added[:, :2] @ (along[1], along[0])
    assert np.abs(across).max() < 1e-9
    assert not added[:, 2].any(), "the height is left alone"


@pytest.mark.parametrize("yaw", [0.6, 2.5])
def test_feet_that_are_turned_sway_the_same_way_in_space(
    model: RobotModel, yaw: float
) -> None:
    _, ahead = swaying(model, axis="pitch", size_rad=SMALL_RAD, periods=2)
    _, turned = swaying(model, axis="pitch", size_rad=SMALL_RAD, yaw=yaw, periods=2)
    size = np.abs(ahead[:, 0]).max()
    assert np.abs(turned[:, :2] - ahead[:, :2]).max() < SHARE * size


@pytest.mark.parametrize("size_rad", [SMALL_RAD, STEEP_RAD])
def test_velocity_and_acceleration_are_those_of_the_place(
    model: RobotModel, size_rad: float
) -> None:
    _, added = swaying(model, axis="pitch", size_rad=size_rad, hz=0.5)
    place, velocity, acceleration = added[:, 0], added[:, 3], added[:, 6]
    for value, rate in ((place, velocity), (velocity, acceleration)):
        slopes = np.diff(value) / DT
        between = 0.5 * (rate[1:] + rate[:-1])
        in_a_tick = np.abs(np.diff(rate)).max()
        assert in_a_tick < 0.2 * np.abs(rate).max()
        assert np.abs(slopes - between).max() < in_a_tick


@pytest.mark.parametrize("axis", ["pitch", "roll"])
def test_steep_ground_moves_nobody_beyond_the_reach(
    model: RobotModel, axis: str
) -> None:
    settings = msgspec.structs.replace(PEOPLE, gain=10.0)
    _, added = swaying(model, axis=axis, size_rad=STEEP_RAD, settings=settings)
    length, width = model.half_sizes[0]
    apart = standing(model).p_sole[0][1]
    reach = REACH * (length if axis == "pitch" else width + apart)
    farthest = np.abs(added[:, :2]).max()
    assert 0.7 * reach < farthest < reach


def test_a_sudden_steep_tilt_asks_for_no_pressure_beyond_the_soles(
    model: RobotModel,
) -> None:
    """By the inverted pendulum's zero-moment point."""
    sway = Sway(PEOPLE, WalkSettings(), half_sizes=model.half_sizes, period_s=DT)
    stance = standing(model)
    upright = float(stance.com[0])
    sway.begin(soles_on(stance, Rotation.identity(), np.zeros(3)), stance)
    steep = soles_on(stance, Rotation.from_euler("y", STEEP_RAD), np.zeros(3))
    pressures = []
    for _ in range(round(3.0 / DT)):
        sway.step(steep, stance, stands=True)
        sway.move(stance, 1.0)
        pull = stance.com_acceleration[0] * stance.com_nominal / GRAVITY
        pressures.append(float(stance.com[0] - pull) - upright)
        sway.move(stance, -1.0)
    half_length = model.half_sizes[0][0]
    assert 0.5 * half_length < np.abs(pressures).max() < half_length


def test_a_tilt_that_stays_is_stood_up_against(model: RobotModel) -> None:
    sway = Sway(PEOPLE, WalkSettings(), half_sizes=model.half_sizes, period_s=DT)
    stance = standing(model)
    level, tilted = (
        soles_on(stance, Rotation.from_euler("y", angle), np.zeros(3))
        for angle in (0.0, SMALL_RAD)
    )
    sway.begin(level, stance)
    ways = []
    upright = float(stance.com[0])
    for _ in range(round(6.0 * PEOPLE.upright_again_s / DT)):
        sway.step(tilted, stance, stands=True)
        sway.move(stance, 1.0)
        ways.append(float(stance.com[0]) - upright)
        sway.move(stance, -1.0)
    assert max(ways) > PEOPLE.gain * SMALL_RAD * stance.com_nominal * 0.8
    assert abs(ways[-1]) < 0.01 * max(ways)


def test_a_start_on_a_slope_asks_for_no_lean(model: RobotModel) -> None:
    sway = Sway(PEOPLE, WalkSettings(), half_sizes=model.half_sizes, period_s=DT)
    stance = standing(model)
    slope = soles_on(stance, Rotation.from_euler("y", 0.05), np.zeros(3))
    for _ in range(round(0.3 / DT)):
        sway.begin(slope, stance)
    for _ in range(round(1.0 / DT)):
        sway.step(slope, stance, stands=True)
    sway.move(stance, 1.0)
    assert abs(stance.com[0] - standing(model).com[0]) < 1e-4


def test_who_walks_or_has_lost_a_foot_comes_back(model: RobotModel) -> None:
    sway = Sway(PEOPLE, WalkSettings(), half_sizes=model.half_sizes, period_s=DT)
    stance = standing(model)
    start = stance.com.copy()
    sway.begin(soles_on(stance, Rotation.identity(), np.zeros(3)), stance)
    tilted = soles_on(stance, Rotation.from_euler("x", 0.02), np.zeros(3))
    farthest = 0.0
    for tick in range(round(5.0 / DT)):
        sway.step(tilted, stance, stands=tick * DT < 1.0)
        sway.move(stance, 1.0)
        way = float(np.linalg.norm(stance.com - start))
        sway.move(stance, -1.0)
        farthest = max(farthest, way)
    assert farthest > 0.02
    assert way < 1e-3


def test_soles_that_disagree_show_no_tilt_to_go_with(model: RobotModel) -> None:
    """A platform for each foot is no ground that tilts."""
    sway = Sway(PEOPLE, WalkSettings(), half_sizes=model.half_sizes, period_s=DT)
    stance = standing(model)
    soles = soles_on(stance, Rotation.identity(), np.zeros(3))
    sway.begin(soles, stance)
    soles.R_world_sole = [Rotation.from_euler("y", 0.2).as_matrix(), np.eye(3)]
    for _ in range(round(2.0 / DT)):
        sway.step(soles, stance, stands=True)
    sway.move(stance, 1.0)
    assert np.abs(stance.com - standing(model).com).max() < 1e-4


def test_shipped_settings_change_nothing_but_the_sway() -> None:
    found = build_settings(read_toml(PRESETS_DIR / "person.toml"), overrides=[])
    assert found.sway.gain > 1.0
    others = msgspec.structs.replace(found, sway=ControllerSettings().sway)
    assert others == ControllerSettings()


def tilting(axis: str, size_deg: float) -> dict[str, Any]:
    """Return a scenario whose platform swings slowly by a size to both sides."""
    motion = swing(axis, size_deg, SLOW_HZ, start_s=0.5)
    return {"duration_s": 4.5, "platform": [{"foot": "both", "motion": [motion]}]}


@pytest.mark.closed_loop
def test_without_gain_the_filter_is_of_no_account(walker: Robot) -> None:
    """Bit for bit what it is without any of these settings."""
    other = SwaySettings(frequency_hz=2.0, damping=0.1, upright_again_s=1.0)
    runs = [
        run_closed_loop(
            walker,
            controller=WholeBodyController(walker, ControllerSettings(sway=sway)),
            **{**tilting("pitch", 2.0), "duration_s": 1.0},
        )
        for sway in (SwaySettings(), other)
    ]
    np.testing.assert_array_equal(runs[0].commands, runs[1].commands)


@pytest.mark.closed_loop
@pytest.mark.usual("pitch")  # as people were measured
@pytest.mark.parametrize("axis", ["pitch", "roll"])
def test_robot_sways_as_asked(walker: Robot, model: RobotModel, axis: str) -> None:
    scenario = tilting(axis, SMALL_DEG)
    run = swaying_robot(walker, scenario)
    assert run.statuses == {"ok"}
    side = ("pitch", "roll").index(axis)
    way = (run.com_true - run.soles_true.mean(axis=1) - standing(model).com)[:, side]
    sign = 1.0 if axis == "pitch" else -1.0
    wanted = sign * standing(model).com_nominal * asked_lean(scenario, run.time_s)
    assert np.abs(wanted).max() > 5.0 * TRACKED_M
    assert np.abs(way - wanted).max() < TRACKED_M
    told = (run.com - run.com_reference)[run.time_s > 1.0, side]
    assert np.abs(told).max() < TRACKED_M


@pytest.mark.closed_loop
def test_robot_on_steep_ground_stays_over_its_soles(
    walker: Robot, model: RobotModel
) -> None:
    run = swaying_robot(walker, tilting("pitch", STEEP_DEG))
    assert not run.fell
    assert run.statuses == {"ok"}
    over = (run.com_true - run.soles_true.mean(axis=1))[:, 0]
    half_length = model.half_sizes[0][0]
    assert 0.5 * half_length < np.abs(over).max() < MOST_OF_SOLE * half_length


def swaying_robot(robot: Robot, scenario: dict[str, Any]) -> Run:
    controller = WholeBodyController(robot, ControllerSettings(sway=PEOPLE))
    return run_closed_loop(robot, controller=controller, **scenario)


def asked_lean(scenario: dict[str, Any], time_s: Array) -> Array:
    """Return (n,) the lean of the filter's equations for the true tilt [rad]."""
    motion = convert(scenario["platform"][0]["motion"][0], SineMotion, source="test")
    law = motion_law(motion)
    omega = 2.0 * math.pi * PEOPLE.frequency_hz
    lasting = lean = rate = 0.0
    dt, leans = float(time_s[1] - time_s[0]), []
    for now in time_s.tolist():
        tilt, _ = law(now)
        lasting += dt / PEOPLE.upright_again_s * (tilt - lasting)
        pull = PEOPLE.gain * (tilt - lasting) - lean
        rate += dt * (omega * omega * pull - 2.0 * PEOPLE.damping * omega * rate)
        lean += dt * rate
        leans.append(lean)
    return np.array(leans)
