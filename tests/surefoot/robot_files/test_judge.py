"""Checks of robot files: known figures, and a line for each mistake."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import surefoot as sf
from surefoot.errors import UsageError
from surefoot.robot_files.judge import (
    one_foot_finding,
    quick_findings,
    reach_findings,
    warnings_of,
)
from surefoot.robot_files.scenario_fit import fit, scale_to_robot
from surefoot.robot_io.robot import Robot, load_robot, make_robot
from surefoot.schemas.motions import SineMotion
from surefoot.schemas.scenario import Platform, Push, Scenario
from surefoot.schemas.walk_plan import Walk, WalkStep
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.pushes import CaptureLimit
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.legs import one_foot_share
from surefoot.stabilizer.stance.nominal import (
    DIRECTIONS,
    capture_limits,
    reach_search,
    stand,
)
from surefoot.stabilizer.stance.solver import Reach
from surefoot.stabilizer.walking.feet import FootState

WALKER = load_robot("walker")
STILL = Scenario(name="still", duration_s=1.0)
HEAVE = Scenario(
    name="heave",
    duration_s=3.0,
    platform=[
        Platform(
            foot="both",
            motion=[
                SineMotion(axis="z", amplitude_m=0.3, frequency_hz=0.5),
                SineMotion(axis="x", amplitude_m=0.1, frequency_hz=0.5),
            ],
        )
    ],
)


def changed_joints(where: str = "", **changes: Any) -> Robot:
    joints = [
        msgspec.structs.replace(joint, **changes) if where in joint.name else joint
        for joint in WALKER.file.joint
    ]
    file = msgspec.structs.replace(WALKER.file, joint=joints)
    return make_robot(file, path=WALKER.path, urdf_path=WALKER.urdf_path)


@pytest.mark.parametrize("name", ["walker", "walker-real"])
def test_shipped_robots_have_no_warnings(name: str) -> None:
    assert not warnings_of(load_robot(name))


@pytest.mark.parametrize(
    ("robot", "name", "word"),
    [
        (changed_joints(kp_nm_rad=200.0), "servos under gravity", "soft"),
        (changed_joints("ankle", armature_kg_m2=0.001), "rotor inertia", "left_ankle"),
        (changed_joints("right_ankle_pitch", nominal_rad=-0.4), "soles", "flat"),
    ],
    ids=["soft", "no rotors", "tilted"],
)
def test_a_mistake_is_warned_of(robot: Robot, name: str, word: str) -> None:
    warned = [f for f in quick_findings(robot) if f.verdict == "warning"]
    assert any(name in f.name and word in f.advice for f in warned)


def test_a_robot_whose_knees_are_too_weak_to_walk_is_told_so(tmp_path: Path) -> None:
    needed = one_foot_share(RobotModel(WALKER))
    assert one_foot_finding(needed).verdict == "ok"
    strong, limit = 270.0, round(0.8 * needed * 270.0, 3)
    urdf = tmp_path / "weak.urdf"
    text = WALKER.urdf_path.read_text(encoding="utf-8")
    urdf.write_text(text.replace(f'effort="{strong:g}"', f'effort="{limit}"'))
    joints = [
        msgspec.structs.replace(joint, torque_limit_nm=limit)
        if joint.torque_limit_nm == strong
        else joint
        for joint in WALKER.file.joint
    ]
    file = msgspec.structs.replace(WALKER.file, joint=joints)
    weak = make_robot(file, path=WALKER.path, urdf_path=urdf)
    assert one_foot_share(RobotModel(weak)) == pytest.approx(1.25, rel=1e-3)
    assert one_foot_finding(1.25).verdict == "warning"
    walk = load_scenario("walk-flat-slow")
    assert fit(walk, WALKER).why == ""
    assert "125 % of its torque" in fit(walk, weak).why
    with pytest.raises(UsageError, match="cannot walk"):
        scale_to_robot(walk, weak)


def test_one_foot_needs_what_the_simulated_knee_gives() -> None:
    """In single support on level ground, slowly: within what moving the robot takes."""
    scenario = Scenario(
        name="slow step",
        duration_s=9.0,
        walk=Walk(velocity_m_s=0.01, start_s=0.5, step_s=1.2, double_s=0.8),
    )
    signals = sf.simulate(WALKER, scenario).signals
    knee = WALKER.joint_names.index("right_knee")
    alone = signals["foot_state"][:, 0] == list(FootState).index(FootState.SWING)
    torque = np.abs(signals["effort"][alone, knee])
    share = float(np.median(torque)) / WALKER.torque_limit[knee]
    assert share == pytest.approx(one_foot_share(RobotModel(WALKER)), rel=0.15)


def test_torques_hold_the_robot_as_the_simulators_do() -> None:
    plant = Plant(WALKER, STILL, seed=0)
    for _ in range(300):
        plant.step(WALKER.nominal)
    actual = plant.data.actuator_force
    standing = stand(RobotModel(WALKER))
    legs = RobotModel(WALKER).is_leg[RobotModel(WALKER).to_bus]
    knees = [i for i, n in enumerate(WALKER.joint_names) if n.endswith("knee")]
    np.testing.assert_allclose(standing.torques[knees], actual[knees], rtol=0.15)
    assert np.abs(standing.torques - actual)[legs].max() < 20.0


def test_the_capture_limit_is_the_one_of_the_scenarios_pushes() -> None:
    plant = Plant(WALKER, STILL, seed=0)
    limit = CaptureLimit(WALKER, plant.world, plant.data)
    angles = math.tau * np.arange(DIRECTIONS) / DIRECTIONS
    simulated = [limit.impulse(np.array([math.cos(a), math.sin(a)])) for a in angles]
    np.testing.assert_allclose(capture_limits(RobotModel(WALKER)), simulated, rtol=0.02)


def test_what_fits_is_left_as_it_is() -> None:
    small = HEAVE.platform[0].motion[0]
    calm = msgspec.structs.replace(
        HEAVE,
        platform=[
            Platform(
                foot="left", motion=[msgspec.structs.replace(small, amplitude_m=0.02)]
            )
        ],
    )
    assert fit(calm, WALKER).why == ""
    assert scale_to_robot(calm, WALKER) == (calm, "")


def test_a_scaled_scenario_fits_and_is_of_the_same_shape() -> None:
    found = fit(HEAVE, WALKER)
    assert 0.1 < found.ground_share < 0.9
    scaled, told = scale_to_robot(HEAVE, WALKER)
    assert "%" in told
    assert fit(scaled, WALKER).why == ""
    before, after = HEAVE.platform[0].motion, scaled.platform[0].motion
    shares = [a.amplitude / b.amplitude for a, b in zip(after, before, strict=True)]
    assert shares[0] == pytest.approx(shares[1])
    assert shares[0] < found.ground_share


def test_a_push_beyond_the_capture_limit_is_scaled_below_it() -> None:
    hard = Scenario(
        name="hard",
        duration_s=2.0,
        push=[Push(force_n=(0.0, 900.0, 0.0), start_s=1.0, duration_s=0.2)],
    )
    assert fit(hard, WALKER).push_share > 1.0
    scaled, _ = scale_to_robot(hard, WALKER)
    assert fit(scaled, WALKER).push_share == pytest.approx(0.6)


def striding(**changes: Any) -> Scenario:
    return Scenario(name="strides", duration_s=8.0, walk=Walk(**changes))


def test_steps_longer_than_both_soles_reach_are_told_and_shortened() -> None:
    long = striding(velocity_m_s=1.1, step_s=0.6, double_s=0.2)
    found = fit(long, WALKER)
    assert 0.5 < found.step_share < 0.9
    assert found.why.startswith(f"both soles reach {100.0 * found.step_share:.0f} %")
    scaled, told = scale_to_robot(long, WALKER)
    assert "the walk's velocity to" in told
    assert fit(scaled, WALKER).step_share == 1.0
    assert fit(striding(velocity_m_s=0.3), WALKER).step_share == 1.0


def test_written_steps_out_of_reach_cannot_be_scaled() -> None:
    step = WalkStep(side="left", position_m=(0.9, 0.11), yaw_deg=0.0)
    with pytest.raises(UsageError, match=r"cannot walk: both soles reach \d+ %"):
        scale_to_robot(striding(step=[step]), WALKER)


def test_a_stair_may_be_too_high() -> None:
    low, high = (
        striding(step=[WalkStep(side="left", position_m=(0.3, 0.11), rise_m=rise)])
        for rise in (0.03, 0.3)
    )
    assert fit(low, WALKER).step_share == 1.0
    assert fit(high, WALKER).step_share < 0.9


def test_reach_ends_where_the_knee_would_be_straight() -> None:
    reach = reach_search(RobotModel(WALKER)).reach()
    sink, rise = WALKER.file.com_travel_m
    assert rise <= reach.rise_m < rise + 0.03
    assert reach.sink_m > -sink - 0.01


def test_slow_heave_takes_the_robot_along() -> None:
    slow = msgspec.structs.replace(
        HEAVE,
        duration_s=60.0,
        platform=[
            Platform(
                foot="both",
                motion=[SineMotion(axis="z", amplitude_m=0.3, frequency_hz=0.03)],
            )
        ],
    )
    assert fit(slow, WALKER).why == ""


@pytest.mark.parametrize(("height_m", "is_straight"), [(0.13, False), (0.83, True)])
def test_legs_are_straight_for_the_robot_s_height(
    height_m: float, is_straight: bool
) -> None:
    reach = Reach(rise_m=0.016, sink_m=0.3, roll_rad=0.3, pitch_rad=(0.4, 0.4))
    rise, _ = reach_findings(WALKER, reach, height_m)
    assert ("straight legs" in rise.advice) is is_straight
