"""The safety layer with healthy runs, with lost sensors and after a fall."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.realtime import quiet_interpreter
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.messages import Reference
from surefoot.schemas.reasons import EndReason, SensorTrouble, StabilizerState, plain
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings, SafetySettings
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.simulation import Simulation
from surefoot.stabilizer.controller import ControllerOutput, HoldController
from surefoot.stabilizer.safety.health import FRESH, SensorHealth
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import DELAY, NOISE
from tests.stabilizer.watched_run import watched_run

ACTIVE, DEGRADED = StabilizerState.ACTIVE, StabilizerState.DEGRADED
FADE_OUT, HELD = StabilizerState.FADE_OUT, StabilizerState.HELD
FEET = ("left_ankle_ft", "right_ankle_ft")
MOVING_TICKS = 800
LEAVE_S = 0.2
CORRECTED_MM = 3.0
"""CoM error with an accelerometer whose bias is known [mm]."""


def motion(axis: str, kind: str, **more: float) -> dict[str, Any]:
    return {"axis": axis, "kind": kind, "start_s": 0.3, **more}


def sine(axis: str, amplitude_deg: float, frequency_hz: float) -> dict[str, Any]:
    return motion(axis, "sine", amplitude_deg=amplitude_deg, frequency_hz=frequency_hz)


DROP = [
    motion("z", "drop", amplitude_m=-0.08),
    motion("roll", "ramp", amplitude_deg=10.0, rate_deg_s=100.0),
]
RAMP = [motion("roll", "ramp", amplitude_deg=15.0, rate_deg_s=180.0)]
PUSH = {"body": "torso", "force_n": [0.0, 200.0, 0.0], "start_s": 0.3}
SLOW = {
    "duration_s": 1.3,
    "platform": [{"foot": "both", "motion": [sine("roll", 6.0, 0.25)]}],
}
HEALTHY: dict[str, dict[str, Any]] = {
    "drop": {
        "duration_s": 1.5,
        "platform": [{"foot": "left", "motion": DROP}, {"foot": "right"}],
    },
    # Without noise sensors repeat exactly, and jump most from rest.
    "ramp": {
        "duration_s": 1.0,
        "platform": [{"foot": "both", "motion": RAMP}],
        "sensors": {},
    },
    "push": {"duration_s": 1.2, "push": [{**PUSH, "duration_s": 0.1}]},
}


class Spy(WholeBodyController):
    """A controller that keeps its last input and its last answer."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, ControllerSettings())

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        self.given = snapshot
        self.answered = super().step(snapshot, reference)
        return self.answered


@pytest.mark.closed_loop
@pytest.mark.parametrize("name", HEALTHY)
def test_healthy_runs_do_not_know_that_they_are_watched(
    walker: Robot, name: str
) -> None:
    table = {"name": "test", "delay": DELAY, "sensors": NOISE, **HEALTHY[name]}
    sim = Simulation(walker, scenario_from_table(table, source="test"))
    controller = Spy(walker)
    while not sim.finished:
        sensed = sim.snapshot
        output = sim.step(controller)
        assert controller.given is sensed
        assert output is controller.answered
    assert sim.safety is not None
    assert sim.safety.detail == ""


def fault(sensor: str, kind: str, **more: Any) -> dict[str, Any]:
    row = {"sensor": sensor, "kind": kind, "start_s": 0.3, "duration_s": 10.0}
    return row | more


class Noticing(Spy):
    """A controller that has noticed a change of the gyroscope's bias."""

    def imu_trouble(self) -> tuple[SensorTrouble, str]:
        return SensorTrouble.OFFSET, ""


def test_a_gyroscope_that_goes_off_is_named_and_still_used(walker: Robot) -> None:
    # What notices it: test_sensor_biases.py.
    table = {"name": "test", "delay": DELAY, "sensors": NOISE, "duration_s": 0.1}
    sim = Simulation(walker, scenario_from_table(table, source="test"))
    controller = Noticing(walker)
    while not sim.finished:
        sensed = sim.snapshot
        sim.step(controller)
        assert controller.given is sensed
    assert sim.safety is not None
    assert sim.safety.losses == {"imu": SensorTrouble.OFFSET}
    assert sim.safety.state is ACTIVE


# Every sensor and kind without a robot: test_health.py.
@pytest.mark.closed_loop
@pytest.mark.usual("joints-freeze-frozen", "left_ankle_ft-nan-missing")
@pytest.mark.parametrize(
    ("sensor", "kind", "trouble"),
    [
        ("joints", "freeze", SensorTrouble.FROZEN),
        ("imu", "range", SensorTrouble.OUT_OF_RANGE),
        ("left_ankle_ft", "nan", SensorTrouble.MISSING),
        ("right_ankle_ft", "jump", SensorTrouble.JUMPED),
    ],
)
def test_a_lost_sensor_is_named_and_the_robot_stands(
    walker: Robot, sensor: str, kind: str, trouble: SensorTrouble
) -> None:
    size = {"size": 9000.0} if kind == "jump" else {}
    run = watched_run(walker, duration_s=0.7, fault=[fault(sensor, kind, **size)])
    assert not run.fell
    assert run.losses == {sensor: trouble}
    assert run.detail == f"{sensor} {plain(trouble)}"
    if sensor in FEET:
        assert run.states == [ACTIVE, DEGRADED]
        assert run.end is EndReason.NONE
    else:
        assert run.states == [ACTIVE, FADE_OUT, HELD]
        assert run.end is EndReason.SENSOR_LOST


def part(sensor: str, kind: str, name: str, **more: Any) -> dict[str, Any]:
    return fault(sensor, kind, part=name, start_s=0.6, **more)


PARTS = {
    "gyroscope's pitch stuck": part("imu", "freeze", "angular_velocity", axis="y"),
    "gyroscope off": part("imu", "jump", "angular_velocity", axis="x", size=0.3),
    "roll moment off": part("right_ankle_ft", "jump", "moment", axis="x", size=60.0),
}


@pytest.mark.closed_loop
@pytest.mark.parametrize("name", PARTS)
def test_a_part_of_a_sensor_that_fails_alone_is_told_in_time(
    walker: Robot, name: str
) -> None:
    """Else the robot falls within two seconds, and nobody knows why."""
    failing = PARTS[name]
    ground = [{"foot": "both", "motion": [sine("pitch", 4.0, 0.3)]}]
    run = watched_run(walker, duration_s=1.3, platform=ground, fault=[failing])
    assert not run.fell
    is_off = failing["kind"] == "jump"
    trouble = SensorTrouble.INCONSISTENT if is_off else SensorTrouble.FROZEN
    assert run.losses == {failing["sensor"]: trouble}
    is_foot = failing["sensor"] in FEET
    assert run.end is (EndReason.NONE if is_foot else EndReason.SENSOR_LOST)
    assert run.detail.startswith(f"{failing['sensor']} {plain(trouble)}")


@pytest.mark.closed_loop
@pytest.mark.parametrize("off", [(0.45, 0.0, 0.0), (0.3, -0.4, 0.0)])
def test_an_accelerometer_that_is_off_a_little_is_corrected(
    walker: Robot, off: tuple[float, ...]
) -> None:
    sensors = {**NOISE, "accel_bias_m_s2": list(off)}
    run = watched_run(walker, duration_s=2.0, sensors=sensors)
    assert run.states == [ACTIVE]
    assert run.com_error_max_mm is not None
    assert max(run.com_error_max_mm) < CORRECTED_MM


@pytest.mark.closed_loop
@pytest.mark.parametrize("off", [(0.9, 0.0, 0.0), (0.0, -2.0, 0.0)])
def test_one_that_is_off_by_more_is_told_before_the_robot_moves(
    walker: Robot, off: tuple[float, ...]
) -> None:
    sensors = {**NOISE, "accel_bias_m_s2": list(off)}
    run = watched_run(walker, duration_s=1.0, sensors=sensors)
    assert not run.fell
    assert run.states == [ACTIVE, FADE_OUT, HELD]
    assert run.losses == {"imu": SensorTrouble.INCONSISTENT}
    told = re.match(r"imu inconsistent: .* differ by ([\d.]+) m/s\^2", run.detail)
    assert told is not None
    assert float(told[1]) == pytest.approx(max(map(abs, off)), rel=0.1)


@pytest.mark.closed_loop
@pytest.mark.parametrize(("force_n", "seconds"), [(180.0, 0.1), (300.0, 0.05)])
def test_a_push_at_the_start_is_no_wrong_accelerometer(
    walker: Robot, force_n: float, seconds: float
) -> None:
    push = {"body": "torso", "force_n": [0.0, force_n, 0.0], "start_s": 0.1}
    run = watched_run(walker, duration_s=1.5, push=[{**push, "duration_s": seconds}])
    assert run.states == [ACTIVE]
    assert not run.fell


@pytest.mark.closed_loop
def test_ground_that_shakes_at_the_start_is_no_wrong_accelerometer(
    walker: Robot,
) -> None:
    shaking = [sine("x", 0.0, 1.0) | {"amplitude_m": 0.06}, sine("pitch", 6.0, 0.8)]
    del shaking[0]["amplitude_deg"]
    ground = [{"foot": "both", "motion": shaking}]
    run = watched_run(walker, duration_s=1.0, platform=ground)
    assert run.states == [ACTIVE]


@pytest.mark.closed_loop
def test_an_offset_as_large_as_an_impact_is_told_by_its_length(walker: Robot) -> None:
    off = fault("right_ankle_ft", "jump")
    run = watched_run(walker, duration_s=1.0, fault=[off])
    assert not run.fell
    assert run.states == [ACTIVE, DEGRADED]
    assert run.losses == {"right_ankle_ft": SensorTrouble.OVERLOADED}


@pytest.mark.closed_loop
def test_moments_without_a_sensor_are_bridged(walker: Robot) -> None:
    moments = [
        fault("imu", kind, start_s=start_s, duration_s=0.009)
        for kind, start_s in (("drop", 0.3), ("nan", 0.4), ("range", 0.5))
    ]
    run = watched_run(walker, duration_s=0.65, fault=moments)
    assert not run.fell
    assert run.details == [""]


@pytest.mark.closed_loop
def test_an_ankle_sensor_that_is_back_is_believed_again(walker: Robot) -> None:
    short = fault("right_ankle_ft", "range", duration_s=0.1)
    run = watched_run(walker, duration_s=0.8, fault=[short])
    assert not run.fell
    assert run.states == [ACTIVE, DEGRADED, ACTIVE]
    assert run.losses == {"right_ankle_ft": SensorTrouble.OUT_OF_RANGE}
    assert [bool(detail) for detail in run.details] == [False, True, False]


@pytest.mark.closed_loop
def test_both_ankle_sensors_lost_hold_the_posture(walker: Robot) -> None:
    both = [fault(sensor, "drop") for sensor in FEET]
    run = watched_run(walker, duration_s=1.0, fault=both)
    assert not run.fell
    assert run.states == [ACTIVE, FADE_OUT, HELD]
    assert run.end is EndReason.SENSOR_LOST
    assert run.detail == "left_ankle_ft missing, right_ankle_ft missing"


@pytest.mark.parametrize("speed", [1e3, 1e200])
def test_an_impossible_joint_speed_is_not_believed(walker: Robot, speed: float) -> None:
    first, second = standing_readings(walker, 2)
    dq = second.dq.copy()
    dq[3] = speed
    health = SensorHealth(walker, SafetySettings())
    health.check(first, FRESH, moves=lambda: True)
    with quiet_interpreter():  # as around every loop
        believed = health.check(replace(second, dq=dq), FRESH, moves=lambda: True)
    assert np.array_equal(believed.dq, first.dq)
    assert health.all_believed  # bridged, for a moment


# A fall ----------------------------------------------------------------------------


def standing_readings(walker: Robot, ticks: int) -> list[Snapshot]:
    table = {"name": "test", "duration_s": 10.0, "sensors": NOISE}
    scenario = scenario_from_table(table, source="test")
    simulated = SimulatedRobot(walker, scenario, seed=0)
    readings = []
    for _ in range(ticks):
        readings.append(simulated.sense())
        simulated.step()
    return readings


def answer(walker: Robot, readings: list[Snapshot]) -> Safety:
    safety = Safety(HoldController(walker.n_a), walker, SafetySettings())
    safety.start(readings[0], walker.nominal)
    for reading in readings:
        safety.step(reading, FRESH)
    return safety


@pytest.mark.parametrize(("lean", "fell"), [(0.75, False), (0.85, True)])
def test_leaning_too_far_is_a_fall(walker: Robot, lean: float, fell: bool) -> None:
    readings = standing_readings(walker, 20)
    attitude = np.array([math.sin(0.5 * lean), 0.0, 0.0, math.cos(0.5 * lean)])
    leaning = [replace(reading, quat_xyzw=attitude) for reading in readings[1:]]
    safety = answer(walker, [readings[0], *leaning])
    assert safety.end is (EndReason.FELL if fell else EndReason.NONE)
    assert safety.detail == ("leans by 49 deg" if fell else "")


@pytest.mark.parametrize(("ticks", "fell"), [(900, False), (1100, True)])
def test_feet_without_load_for_a_second_are_a_fall(
    walker: Robot, ticks: int, fell: bool
) -> None:
    readings = standing_readings(walker, ticks)
    lift = np.array([0.0, 0.0, 400.0, 0.0, 0.0, 0.0])
    lifted = [
        replace(r, ft_left=r.ft_left - lift, ft_right=r.ft_right - lift)
        for r in readings
    ]
    end = answer(walker, lifted).end
    assert end is (EndReason.FELL if fell else EndReason.NONE)


@pytest.mark.parametrize("missed", [(1, 2, 5, 6, 7), (3, 4)])
def test_a_turning_robot_may_lose_ticks(walker: Robot, missed: tuple[int, ...]) -> None:
    turned = []
    for reading in standing_readings(walker, 1500):
        angle, rate = 0.2 * math.sin(0.015 * reading.tick), 3.0
        rate *= math.cos(0.015 * reading.tick)
        turned.append(
            replace(
                reading,
                quat_xyzw=np.array([math.sin(angle / 2), 0, 0, math.cos(angle / 2)]),
                angular_velocity=np.array([rate, 0.0, 0.0]),
            )
        )
    heard = [reading for reading in turned if reading.tick % 10 not in missed]
    assert answer(walker, heard).state is ACTIVE


# Asked to stop ---------------------------------------------------------------------


def leave(walker: Robot, leave_s: float) -> tuple[Safety, list[float]]:
    """Ask a moving controller to stop; return its command's steps from then on."""
    table = {"name": "test", "sensors": NOISE, **SLOW}
    settings = ControllerSettings(safety=SafetySettings(leave_s=leave_s))
    scenario = scenario_from_table(table, source="test")
    sim = Simulation(walker, scenario, settings=settings)
    controller = WholeBodyController(walker, settings)
    steps, before = [], walker.nominal.copy()
    while sim.safety is None or not sim.safety.is_done:
        if sim.tick == MOVING_TICKS:
            assert sim.safety is not None
            sim.safety.request_soft_stop("TEST")
        output = sim.step(controller)
        assert output is not None
        steps.append(float(np.abs(output.q_command - before).max()))
        before = output.q_command.copy()
    return sim.safety, steps


def test_asked_to_stop_the_command_comes_to_rest_in_time(walker: Robot) -> None:
    safety, steps = leave(walker, LEAVE_S)
    moving, leaving = steps[:MOVING_TICKS], steps[MOVING_TICKS:]
    assert len(leaving) == round(LEAVE_S / walker.period_s)
    assert max(moving[-100:]) > 0.0
    assert max(leaving[len(leaving) // 2 :]) < 0.5 * max(leaving)
    assert leaving[-1] == 0.0
    assert (safety.end, safety.detail) == (EndReason.STOPPED, "TEST")
    reading = standing_readings(walker, 1)[0]
    at_rest = safety.step(reading, FRESH).q_command.copy()
    assert np.array_equal(safety.step(reading, FRESH).q_command, at_rest)


def test_without_a_time_to_leave_the_command_stands_still_at_once(
    walker: Robot,
) -> None:
    _, steps = leave(walker, 0.0)
    assert steps[MOVING_TICKS:] == [0.0]
