from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.result import Distribution, PlantResult
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.errors import CommandError, ScenarioError, SimulationError
from surefoot.sim_robot.simulated_robot import SimulatedRobot

PERIOD_S = 0.001
NO_TIME = Distribution(median=0.0, p99=0.0, max=0.0)
NOISE = {"force_noise_n": 2.0, "gyro_noise_rad_s": 0.002}
HEAVE = {"axis": "z", "kind": "sine", "amplitude_m": 0.02, "frequency_hz": 1.0}
MOVING = {"platform": [{"foot": "both", "motion": [HEAVE]}], "sensors": NOISE}

Make = Callable[..., SimulatedRobot]


@pytest.fixture
def make(walker: Robot, make_scenario: Callable[..., Scenario]) -> Make:
    def build(
        *, seed: int = 0, record: bool = False, **table: object
    ) -> SimulatedRobot:
        scenario = make_scenario(**table)
        return SimulatedRobot(walker, scenario, seed=seed, record=record)

    return build


def answer(snapshot: Snapshot, posture: Array) -> Array:
    """A command that differs from tick to tick and depends on the sensors."""
    wave = 1e-3 * np.sin(0.05 * snapshot.tick + np.arange(posture.size))
    return posture + wave + 1e-5 * snapshot.angular_velocity[0]


def run(simulated: SimulatedRobot, *, ticks: int) -> list[Array]:
    """Lockstep in one process; returns the answers by tick."""
    answers = []
    for tick in range(ticks):
        answers.append(answer(simulated.sense(), simulated.held_posture))
        due = simulated.commands_needed(tick)
        if due is not None:
            simulated.apply(answers[due], tick=due)
        simulated.step()
    return answers


def result(simulated: SimulatedRobot) -> PlantResult:
    return simulated.result(
        real_time_factor=1.0,
        round_trip_ms=NO_TIME,
        period_jitter_ms=NO_TIME,
        deadline_misses=2,
        refused={"late": 3},
        clipped={},
    )


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_answer_acts_after_the_delay(make: Make, delay: int) -> None:
    simulated = make(delay={"command_ms": float(delay)}, record=True)
    answers = run(simulated, ticks=20)
    acted = simulated.recording()["q_command"]
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
    assert result(pipelined).log_sha256 == result(prompt).log_sha256


def test_needed_answer_is_the_delay_ago(make: Make) -> None:
    simulated = make(delay={"command_ms": 3.0})
    needed = [simulated.commands_needed(tick) for tick in range(6)]
    assert needed == [None, None, None, 0, 1, 2]


def test_answer_may_be_overwritten_by_its_sender(make: Make) -> None:
    """A controller may hand over the same array every tick."""
    simulated = make(delay={"command_ms": 2.0}, record=True)
    reused = simulated.held_posture.copy()
    for tick in range(6):
        reused += 1e-4
        simulated.apply(reused, tick=tick)
        simulated.step()
    acted = simulated.recording()["q_command"][2:, 0]
    np.testing.assert_allclose(np.diff(acted), 1e-4)


def test_last_posture_goes_on_when_an_answer_is_missing(make: Make) -> None:
    simulated = make(delay={"command_ms": 0.0}, record=True)
    first = simulated.held_posture + 0.001
    simulated.apply(first, tick=0)
    for _ in range(3):
        simulated.step()
    np.testing.assert_array_equal(simulated.recording()["q_command"], [first] * 3)


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
        digests.append(result(simulated).log_sha256)
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


def test_digest_is_that_of_sensors_and_commands_in_order(make: Make) -> None:
    simulated = make(**MOVING, record=True)
    sha = hashlib.sha256()
    for tick in range(10):
        s = simulated.sense()
        posture = simulated.held_posture + 1e-4 * tick
        for part in (s.q, s.dq, s.effort, s.quat_xyzw, s.angular_velocity):
            sha.update(part.astype("<f8").tobytes())
        for part in (s.linear_acceleration, s.ft_left, s.ft_right, posture):
            sha.update(part.astype("<f8").tobytes())
        simulated.advance(posture)
    assert result(simulated).log_sha256 == sha.hexdigest()


def test_recording_changes_nothing(make: Make) -> None:
    kept, plain = make(**MOVING, record=True), make(**MOVING)
    run(kept, ticks=100)
    run(plain, ticks=100)
    assert result(kept).log_sha256 == result(plain).log_sha256


def test_record_holds_every_tick_of_the_run(make: Make, walker: Robot) -> None:
    simulated = make(duration_s=0.2, record=True, **MOVING)
    while not simulated.finished:
        simulated.step()
    arrays = simulated.recording()
    np.testing.assert_allclose(arrays["time_s"], PERIOD_S * np.arange(200))
    assert {len(rows) for rows in arrays.values()} == {200}
    assert arrays["q"].shape == (200, walker.n_a)
    assert arrays["platform_position"].shape == (200, 1, 3)
    carried = arrays["sole_left"] - arrays["platform_position"][:, 0]
    np.testing.assert_allclose(carried, carried[[0] * 200], atol=1e-3)
    total = arrays["F_left"][:, 2] + arrays["F_right"][:, 2]
    assert total[0] == pytest.approx(simulated.plant.world.weight, rel=1e-3)


def test_recording_must_be_asked_for(make: Make) -> None:
    with pytest.raises(SimulationError, match="record=True"):
        make().recording()


def test_run_ends_with_the_scenario(make: Make) -> None:
    simulated = make(duration_s=0.05)
    while not simulated.finished:
        simulated.step()
    assert simulated.tick == 50
    report = result(simulated)
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
    report = result(simulated)
    assert report.fell
    assert report.fell_at_s == pytest.approx(simulated.time_s)
    assert 0.2 < simulated.time_s < 4.0
    assert report.base_tilt_max_deg > 30.0


def test_standing_still_reports_figures_in_file_units(make: Make) -> None:
    simulated = make(duration_s=1.5)
    while not simulated.finished:
        simulated.step()
    report = result(simulated)
    half = 0.5 * simulated.plant.world.weight
    # The servos give way under the weight: the held posture sags, and stays so.
    assert 0.5 < report.com_error_max_mm[2] < 3.0
    assert report.com_error_max_mm == pytest.approx(report.com_error_rms_mm, abs=0.1)
    assert report.base_tilt_max_deg < 1.0
    assert report.force_peak_n == pytest.approx([half, half], rel=1e-3)
    assert max(report.force_deviation_rms_n) < 0.1
    assert report.contact_lost_s == [0.0, 0.0]
