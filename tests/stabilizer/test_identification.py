"""Drives of a standing robot with known parameters are identified."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from surefoot.cli.app import app
from surefoot.errors import ChildFailedError, UsageError
from surefoot.measure import identify_drives, judged, profile_of, write_profile
from surefoot.robot_io.robot import (
    Robot,
    Tare,
    find_robot,
    load_robot,
    load_tare,
    save_tare,
)
from surefoot.robot_io.snapshot import SnapshotLayout
from surefoot.schemas.robot_file import ServoProfile
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.stabilizer.identification import (
    Drive,
    IdentifyController,
    Samples,
    identify,
    motion,
)
from tests.stabilizer.closed_loop import NOISE

pytestmark = pytest.mark.closed_loop
JOINT = "left_ankle_pitch"
LAG_S, SPEED_SHARE, PLAY_RAD = 1.5e-3, 0.1, 3e-4
"""Tolerances: 1.5 ticks of lag, a share of the speed limit, play."""
HIDDEN_RAD_S = 8.0
"""Speed limit that stretches the large step of 0.02 rad by no more than is seen."""


def with_drives(robot: Robot, *, lag_s: float, speed: float) -> Robot:
    profile = ServoProfile(velocity_limit_rad_s=speed, lag_s=lag_s)
    servo = msgspec.structs.replace(robot.file.servo, profiles={"true": profile})
    servo = msgspec.structs.replace(servo, profile="true")
    return replace(robot, file=msgspec.structs.replace(robot.file, servo=servo))


def a_drive(joint: str, lag_s: float = 0.02, speed: float = 3.1) -> Drive:
    return Drive(
        joint=joint,
        lag_s=lag_s,
        velocity_limit_rad_s=speed,
        is_bound=False,
        delay_s=0.001,
        backlash_rad=0.0,
        backlash_is_bound=False,
        stiffness_scale=1.0,
        misfit_rad=0.0,
    )


def imperfect(sensors: dict[str, float] = NOISE, **error: float) -> Scenario:
    table = {"name": "drives", "duration_s": 1.0, "sensors": sensors}
    return scenario_from_table({**table, "model_error": error}, source="test")


@pytest.mark.parametrize(
    ("lag_s", "speed", "play"), [(0.02, 3.1, 0.001), (0.04, 2.0, 0.002)]
)
def test_lag_speed_limit_and_play_are_those_of_the_drive(
    walker: Robot, lag_s: float, speed: float, play: float
) -> None:
    robot = with_drives(walker, lag_s=lag_s, speed=speed)
    (found,) = identify_drives(
        robot,
        joints=[JOINT],
        scenario=imperfect(backlash_rad=play, servo_kp_scale=0.9),
    )
    assert found.lag_s == pytest.approx(lag_s, abs=LAG_S)
    assert found.velocity_limit_rad_s == pytest.approx(speed, rel=SPEED_SHARE)
    assert not found.is_bound
    assert found.backlash_rad == pytest.approx(play, abs=PLAY_RAD)
    assert found.stiffness_scale == pytest.approx(0.9, abs=0.03)


COARSE = {"encoder_resolution_rad": 1e-4, "joints_rate_hz": 500.0}


@pytest.mark.parametrize(("lag_s", "speed"), [(0.02, 3.1), (0.005, 12.0)])
def test_coarse_or_seldom_readings_hide_no_limit(
    walker: Robot, lag_s: float, speed: float
) -> None:
    robot = with_drives(walker, lag_s=lag_s, speed=speed)
    scenario = imperfect({**NOISE, **COARSE}, servo_kp_scale=0.9)
    (found,) = identify_drives(robot, joints=[JOINT], scenario=scenario)
    assert found.lag_s == pytest.approx(lag_s, abs=LAG_S)
    assert found.stiffness_scale == pytest.approx(0.9, abs=0.03)
    assert found.is_bound == (speed > HIDDEN_RAD_S)
    if not found.is_bound:
        assert found.velocity_limit_rad_s == pytest.approx(speed, rel=SPEED_SHARE)


def test_ticks_without_an_answer_leave_the_command_as_it_was(walker: Robot) -> None:
    """Every twelfth; the joint is held by something of twice its drive's stiffness."""
    joint, lag_s, speed = walker.joint_names.index(JOINT), 0.02, 3.1
    dt, kp, kd = walker.period_s, walker.kp.item(joint), walker.kd.item(joint)
    asked = motion(0.02, largest_step=0.01, period_s=dt)
    limited = lagged = sent = q_before = 0.0
    rows = []
    for tick, wanted in enumerate(asked):
        q = lagged / 3.0
        is_answered = tick % 12 != 5
        sent = wanted if is_answered else sent
        effort = kp * (lagged - q) - kd * (q - q_before) / dt
        if is_answered:
            rows.append((float(tick), sent, q, effort))
        limited += np.clip(sent - limited, -speed * dt, speed * dt)
        lagged += -np.expm1(-dt / lag_s) * (limited - lagged)
        q_before = q
    found = identify(walker, joint, Samples(*np.array(rows).T))
    assert found.lag_s == pytest.approx(lag_s, abs=LAG_S)
    assert found.velocity_limit_rad_s == pytest.approx(speed, rel=SPEED_SHARE)
    assert found.delay_s == 0.0
    assert not found.is_bound


def test_a_limit_that_does_not_show_is_a_bound(walker: Robot) -> None:
    robot = with_drives(walker, lag_s=0.005, speed=12.0)
    (found,) = identify_drives(robot, joints=[JOINT], scenario=imperfect())
    assert found.lag_s == pytest.approx(0.005, abs=LAG_S)
    assert found.is_bound
    assert 5.0 < found.velocity_limit_rad_s <= 12.0


def test_a_robot_of_another_rate_has_its_drives_found(walker: Robot) -> None:
    robot = with_drives(walker, lag_s=0.02, speed=3.1)
    gate = msgspec.structs.replace(robot.file.gate, max_loop_delay_s=0.02)
    file = msgspec.structs.replace(robot.file, rate_hz=200.0, gate=gate)
    (found,) = identify_drives(replace(robot, file=file), joints=[JOINT])
    assert found.velocity_limit_rad_s == pytest.approx(3.1, rel=SPEED_SHARE)
    assert found.lag_s == pytest.approx(0.02, abs=2.5e-3)


def test_a_robot_that_does_not_follow_is_not_described(walker: Robot) -> None:
    gate = msgspec.structs.replace(walker.file.gate, max_loop_delay_s=0.0035)
    file = msgspec.structs.replace(walker.file, rate_hz=200.0, gate=gate)
    with pytest.raises(ChildFailedError, match="nothing was written"):
        identify_drives(replace(walker, file=file), joints=[JOINT])


def test_a_joint_that_was_seen_too_seldom_is_named(walker: Robot) -> None:
    """As where the machine is too slow for the robot's own pace."""
    joints = [walker.joint_names.index(JOINT), 0]
    controller = IdentifyController(walker, joints, amplitude_rad=0.02)
    layout = SnapshotLayout(walker.n_a)
    reading = np.zeros(layout.size)
    controller.start(layout.view(0, 0, reading), walker.nominal)
    tick = 0
    while not controller.is_done:
        controller.step(layout.view(tick, 0, reading))
        tick += 3 if controller.progress < 1.0 else 1
    assert controller.unseen == [JOINT]
    with pytest.raises(ChildFailedError, match=f"the motion of {JOINT} less than 90%"):
        judged(controller, amplitude_rad=0.02)


def test_a_limit_that_does_not_show_leaves_the_robots_own(walker: Robot) -> None:
    robot = with_drives(walker, lag_s=0.005, speed=12.0)
    (found,) = identify_drives(robot, joints=[JOINT])
    assert profile_of(robot, [found]).velocity_limit_rad_s == 12.0
    slow = with_drives(walker, lag_s=0.005, speed=1.0)
    reached = profile_of(slow, [found]).velocity_limit_rad_s
    assert reached == pytest.approx(found.velocity_limit_rad_s, abs=1e-3)


def test_the_profile_is_that_of_the_legs_however_many_arms_were_moved(
    walker: Robot,
) -> None:
    """It is the legs' lag that is made up for while the robot balances."""
    legs = [a_drive(name, 0.02, 3.1) for name in ("left_knee", "right_ankle_roll")]
    arms = [a_drive(name, 0.005, 1.0) for name in walker.joint_names if "wrist" in name]
    assert len(arms) > len(legs)
    assert profile_of(walker, [*arms, *legs]) == profile_of(walker, legs)
    assert profile_of(walker, arms).lag_s == 0.005


def test_ground_that_moves_is_refused(walker: Robot) -> None:
    with pytest.raises(UsageError, match="firm, level ground"):
        identify_drives(walker, scenario=load_scenario("moving-platform-fast"))


def test_the_command_writes_a_robot_file_and_replaces_none(tmp_path: Path) -> None:
    out, tared = tmp_path / "mine.toml", tmp_path / "tared.toml"
    tared.write_text(f'extends = "{find_robot("walker")}"\n')
    save_tare(tared, Tare(left=[1.0] * 6, robot="walker"))
    words = ["identify", "--inline", "--servo-profile", "harmonic", "--json"]
    words += ["--joint", JOINT, "--out", str(out), "--robot", str(tared)]
    answer = CliRunner().invoke(app, words)
    assert answer.exit_code == 0, answer.output
    told = json.loads(answer.stdout)
    assert [drive["joint"] for drive in told["drives"]] == [JOINT]
    profile = load_robot(out).servo_profile
    assert profile.lag_s == pytest.approx(0.02, abs=LAG_S)
    assert msgspec.to_builtins(profile) == told["profile"]
    assert load_tare(out) == load_tare(tared)
    before = out.read_text()
    again = CliRunner().invoke(app, words)
    assert "is there already" in str(again.exception)
    assert out.read_text() == before


@pytest.mark.parametrize(
    ("name", "told"), [("mine", "robot file"), ("mine.toml", "tared.tare.toml: left")]
)
def test_what_could_not_be_used_is_refused_before_anything_moves(
    name: str, told: str, tmp_path: Path
) -> None:
    tared = tmp_path / "tared.toml"
    tared.write_text(f'extends = "{find_robot("walker")}"\n')
    (tmp_path / "tared.tare.toml").write_text("left = [1.0]\n")
    words = ["identify", "--inline", "--robot", str(tared), "--joint", JOINT]
    answer = CliRunner().invoke(app, [*words, "--out", str(tmp_path / name)])
    assert told in str(answer.exception)
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize(
    "more", [["--lockstep"], ["--connect", "tcp/robot:7447"], ["--endpoints", "a.toml"]]
)
def test_what_belongs_to_the_bus_is_refused_without_one(
    more: list[str], tmp_path: Path
) -> None:
    words = ["identify", "--inline", "--out", str(tmp_path / "mine.toml")]
    answer = CliRunner().invoke(app, [*words, "--joint", JOINT, *more])
    assert "--inline uses no bus; leave out" in str(answer.exception)


def test_offsets_measured_for_the_file_it_replaces_stay(
    walker: Robot, tmp_path: Path
) -> None:
    out, tared = tmp_path / "mine.toml", tmp_path / "tared.toml"
    tared.write_text(f'extends = "{find_robot("walker")}"\n')
    save_tare(tared, Tare(left=[1.0] * 6))
    newer = Tare(left=[2.0] * 6, measured_on="2026-01-02")
    write_profile(load_robot(tared), [a_drive(walker.joint_names[0])], out)
    save_tare(out, newer)
    drives = [a_drive(walker.joint_names[0])]
    write_profile(load_robot(tared), drives, out, overwrite=True)
    assert load_tare(out) == newer
