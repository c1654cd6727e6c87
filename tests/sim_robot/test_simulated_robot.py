from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.robot_io.ticks.recorder import MemoryTicks
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import FallCriterion
from surefoot.schemas.sensors import SNAPSHOT_FIELDS
from surefoot.sim_robot.catalogue import ScenarioError, list_scenarios, load_scenario
from surefoot.sim_robot.plant import CommandError
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from tests.sim_robot.conftest import MakeScenario, figures
from tests.support import with_rate

PERIOD_S = 0.001
NOISE = {"force_noise_n": 2.0, "gyro_noise_rad_s": 0.002}
HEAVE = {"axis": "z", "kind": "sine", "amplitude_m": 0.02, "frequency_hz": 1.0}
MOVING = {"platform": [{"foot": "both", "motion": [HEAVE]}], "sensors": NOISE}

Make = Callable[..., SimulatedRobot]


@pytest.fixture
def make(walker: Robot, make_scenario: MakeScenario) -> Make:
    def build(
        *, seed: int = 0, ticks: MemoryTicks | None = None, **table: object
    ) -> SimulatedRobot:
        scenario = make_scenario(**table)
        return SimulatedRobot(walker, scenario, seed=seed, ticks=ticks)

    return build


def answer(snapshot: Snapshot, posture: Array) -> Array:
    """Return a command that depends on tick and sensors."""
    wave = 1e-3 * np.sin(0.05 * snapshot.tick + np.arange(posture.size))
    return posture + wave + 1e-5 * snapshot.angular_velocity[0]


def run(simulated: SimulatedRobot, *, ticks: int) -> list[Array]:
    """Run in lockstep in one process; return the answers by tick."""
    answers = []
    for tick in range(ticks):
        answers.append(answer(simulated.sense(), simulated.held_posture))
        due = simulated.commands_needed(tick)
        if due is not None:
            simulated.apply(answers[due], tick=due)
        simulated.step()
    return answers


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_answer_acts_after_the_delay(make: Make, delay: int) -> None:
    ticks = MemoryTicks()
    simulated = make(delay={"command_ms": float(delay)}, ticks=ticks)
    answers = run(simulated, ticks=20)
    acted = ticks.read("q_command")
    assert simulated.command_delay_ticks == delay
    for tick, posture in enumerate(acted):
        if tick < delay:
            np.testing.assert_array_equal(posture, simulated.held_posture)
        else:
            np.testing.assert_array_equal(posture, answers[tick - delay])


def test_answer_may_come_before_it_is_due(make: Make) -> None:
    """Inline runs hand over each answer at once, nodes when it is needed."""
    pipelined, prompt = (make(delay={"command_ms": 2.0}, **MOVING) for _ in range(2))
    run(pipelined, ticks=50)
    for tick in range(50):
        prompt.apply(answer(prompt.sense(), prompt.held_posture), tick=tick)
        prompt.step()
    assert figures(pipelined).log_sha256 == figures(prompt).log_sha256


def test_needed_answer_is_the_delay_ago(make: Make) -> None:
    simulated = make(delay={"command_ms": 3.0})
    needed = [simulated.commands_needed(tick) for tick in range(6)]
    assert needed == [None, None, None, 0, 1, 2]


def test_answer_may_be_overwritten_by_its_sender(make: Make) -> None:
    """A controller may hand over the same array every tick."""
    ticks = MemoryTicks()
    simulated = make(delay={"command_ms": 2.0}, ticks=ticks)
    reused = simulated.held_posture.copy()
    for tick in range(6):
        reused += 1e-4
        simulated.apply(reused, tick=tick)
        simulated.step()
    acted = ticks.read("q_command")[2:, 0]
    np.testing.assert_allclose(np.diff(acted), 1e-4)


def test_last_posture_goes_on_when_an_answer_is_missing(make: Make) -> None:
    ticks = MemoryTicks()
    simulated = make(delay={"command_ms": 0.0}, ticks=ticks)
    first = simulated.held_posture + 0.001
    simulated.apply(first, tick=0)
    for _ in range(3):
        simulated.step()
    np.testing.assert_array_equal(ticks.read("q_command"), [first] * 3)


@pytest.mark.parametrize(("tick", "answers"), [(5, 3), (5, 6)])
def test_answer_out_of_its_time_is_refused(make: Make, tick: int, answers: int) -> None:
    simulated = make(delay={"command_ms": 1.0})
    for _ in range(tick):
        simulated.step()
    with pytest.raises(CommandError, match=rf"answers tick {answers} at tick {tick}"):
        simulated.apply(simulated.held_posture, tick=answers)


def test_command_delay_must_be_whole_ticks(make: Make) -> None:
    with pytest.raises(ScenarioError, match=r"delay\.command_ms: got 1\.5 ms"):
        make(delay={"command_ms": 1.5})


def test_same_seed_same_digest_other_seed_another(make: Make) -> None:
    digests = []
    for seed in (5, 5, 6):
        simulated = make(seed=seed, **MOVING)
        run(simulated, ticks=200)
        digests.append(figures(simulated).log_sha256)
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


def test_digest_is_that_of_sensors_and_commands_in_order(make: Make) -> None:
    simulated = make(**MOVING, ticks=MemoryTicks())
    sha = hashlib.sha256()
    for tick in range(10):
        s = simulated.sense()
        posture = simulated.held_posture + 1e-4 * tick
        for part in (s.q, s.dq, s.effort, s.quat_xyzw, s.angular_velocity):
            sha.update(part.astype("<f8").tobytes())
        for part in (s.linear_acceleration, s.ft_left, s.ft_right, posture):
            sha.update(part.astype("<f8").tobytes())
        simulated.advance(posture)
    assert figures(simulated).log_sha256 == sha.hexdigest()


def test_recording_changes_nothing(make: Make) -> None:
    kept, plain = make(**MOVING, ticks=MemoryTicks()), make(**MOVING)
    run(kept, ticks=100)
    run(plain, ticks=100)
    assert figures(kept).log_sha256 == figures(plain).log_sha256


def test_signals_of_every_tick_are_those_sensed_and_true(
    make: Make, walker: Robot
) -> None:
    ticks = MemoryTicks()
    simulated = make(duration_s=0.2, ticks=ticks, **MOVING)
    sensed, true = [], []
    while not simulated.finished:
        sensed.append(simulated.sense())
        true.append(simulated.truth())
        simulated.step()
    signals = {name: ticks.read(name) for name in ticks.layouts}
    np.testing.assert_array_equal(signals["time_s"], PERIOD_S * np.arange(200))
    np.testing.assert_array_equal(signals["tick"], np.arange(200))
    assert {len(rows) for rows in signals.values()} == {200}
    assert signals["q"].shape == (200, walker.n_a)
    for name in SNAPSHOT_FIELDS:
        expected = [getattr(snapshot, name) for snapshot in sensed]
        np.testing.assert_array_equal(signals[name], expected)
    for name in ("com", "com_velocity", "sole_left", "sole_right"):
        expected = [getattr(truth, name) for truth in true]
        np.testing.assert_array_equal(signals[f"true_{name}"], expected)
    for name, parts in (
        ("true_base_pose", ("base_position", "base_quat_xyzw")),
        ("true_F", ("F_left", "F_right")),
    ):
        pairs = [[getattr(truth, part) for part in parts] for truth in true]
        expected = [np.concatenate(pair) for pair in pairs]
        np.testing.assert_array_equal(signals[name], expected)
    poses = [(t.platforms[0].position, t.platforms[0].quat_xyzw) for t in true]
    expected = [[np.concatenate(pose)] for pose in poses]
    np.testing.assert_array_equal(signals["true_platform_pose"], expected)


def test_run_ends_with_the_scenario(make: Make) -> None:
    simulated = make(duration_s=0.05)
    while not simulated.finished:
        simulated.step()
    assert simulated.tick == 50
    report = figures(simulated)
    assert not report.fell
    assert report.fell_at_s is None
    assert report.ticks == 50
    assert report.duration_s == pytest.approx(0.05)
    assert report.refused == {"late": 3}
    assert report.deadline_misses == 2


def test_run_ends_with_the_fall_and_says_when(make: Make) -> None:
    drop = {"axis": "roll", "kind": "ramp", "amplitude_deg": 40, "rate_deg_s": 200}
    simulated = make(platform=[{"foot": "both", "motion": [drop]}])
    while not simulated.finished:
        simulated.step()
    report = figures(simulated)
    assert report.fell
    assert report.fall in FallCriterion
    assert report.fall_detail
    told = f"at {report.fell_at_s:.2f} s: {report.fall_detail}"
    assert report.end_detail == told
    assert report.fell_at_s == pytest.approx(simulated.time_s)
    assert 0.2 < simulated.time_s < 4.0
    assert report.base_tilt_max_deg > 30.0


def test_standing_still_reports_figures_in_file_units(make: Make) -> None:
    simulated = make(duration_s=1.5)
    while not simulated.finished:
        simulated.step()
    report = figures(simulated)
    half = 0.5 * simulated.plant.world.weight
    # The servos give way under the weight: the held posture sags, and stays so.
    assert 0.5 < report.com_error_max_mm[2] < 3.0
    assert report.com_error_max_mm == pytest.approx(report.com_error_rms_mm, abs=0.1)
    assert report.base_tilt_max_deg < 1.0
    assert report.force_peak_n == pytest.approx([half, half], rel=1e-3)
    assert max(report.force_deviation_rms_n) < 0.1
    assert report.contact_lost_s == [0.0, 0.0]


@pytest.mark.usual(*(f"{name}-200.0" for name in list_scenarios()))
@pytest.mark.parametrize("rate_hz", [200.0, 500.0])
@pytest.mark.parametrize("name", list_scenarios())
def test_shipped_scenarios_fit_robots_of_other_rates(
    walker: Robot, name: str, rate_hz: float
) -> None:
    robot = with_rate(walker, rate_hz)
    simulated = SimulatedRobot(robot, load_scenario(name), seed=0)
    assert simulated.command_delay_ticks == 1
    run(simulated, ticks=2)
    assert simulated.time_s == pytest.approx(2.0 / rate_hz)
