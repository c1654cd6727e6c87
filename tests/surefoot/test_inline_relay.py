"""Faults of the bus in simulated time give the same run on any machine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import surefoot as sf
from surefoot.outcome import Sides
from surefoot.relayed_simulation import RelayedSimulation
from surefoot.robot_io.relay.relay import find_plan
from surefoot.run_plan import RunPlan, make_plan
from surefoot.runs import run_inline
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import EndReason, ModeCause, SensorTrouble
from surefoot.schemas.relay_plan import (
    RelayPlan,
    load_relay_plan,
)
from surefoot.schemas.toml_file import convert
from surefoot.stabilizer.factory import make_controller
from tests.command import Surefoot, scenario_file

pytestmark = pytest.mark.closed_loop

TICKS = 300


def run_plan(scenario: Path, *, controller: str = "whole-body") -> RunPlan:
    """Run a scenario in one process."""
    return make_plan(str(scenario), controller=controller)


def relayed(plan: RunPlan, faults: RelayPlan) -> Sides:
    """Run a scenario with the faults."""
    sim = RelayedSimulation.of_plan(replace(plan, relay=faults))
    sim.run(make_controller(plan.controller, plan.robot, plan.settings))
    return sim.sides()


def shipped(name: str) -> RelayPlan:
    """Return a shipped plan."""
    return load_relay_plan(find_plan(name))


def test_a_clear_relay_changes_no_bit(short_scenario: Path) -> None:
    plan = run_plan(short_scenario)
    plain = run_inline(plan).result
    clear = relayed(plan, shipped("clear"))
    assert clear.plant.log_sha256 == plain.log_sha256
    assert clear.plant.deadline_misses == 0
    assert clear.relay is not None
    assert clear.relay.counts["joint_command"] == {"arrived": TICKS, "left": TICKS}


@pytest.mark.parametrize("name", ["loss-5", "jitter-5ms", "reordered"])
def test_the_same_seed_gives_the_same_run(short_scenario: Path, name: str) -> None:
    runs = [relayed(run_plan(short_scenario), shipped(name)).plant for _ in range(2)]
    assert runs[0].log_sha256 == runs[1].log_sha256
    assert not runs[0].fell
    assert runs[0].deadline_misses > 0


def test_copies_are_refused_and_change_no_bit(short_scenario: Path) -> None:
    plan = run_plan(short_scenario)
    clear = relayed(plan, shipped("clear")).plant
    twice = relayed(plan, shipped("duplicated")).plant
    assert twice.log_sha256 == clear.log_sha256
    assert twice.refused["sequence"] > 0


def cut(channels: list[str], duration_s: float) -> RelayPlan:
    """Return a plan that cuts these channels from 0.1 s on for a duration."""
    fault = {"kind": "cut", "topics": channels, "start_s": 0.1}
    table = {"name": "cut", "fault": [{**fault, "duration_s": duration_s}]}
    return convert(table, RelayPlan, source="test")


def test_a_short_cut_of_commands_is_held_and_gone_on_from(
    short_scenario: Path,
) -> None:
    plan = run_plan(short_scenario, controller="hold")
    faults = cut(["joint_command"], 0.1)
    loop = RelayedSimulation.of_plan(replace(plan, relay=faults))
    loop.run(make_controller(plan.controller, plan.robot, plan.settings))
    modes = [mode for _, mode, _ in loop.modes]
    assert modes == [RobotMode.ACTIVE, RobotMode.HOLD, RobotMode.ACTIVE]
    began_s, _, cause = loop.modes[1]
    assert 0.1 < began_s < 0.13
    assert cause is ModeCause.SILENCE


def test_a_lasting_cut_ends_in_fault_and_says_so(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    scenario, plan = scenario_file(tmp_path, 1.3), tmp_path / "cut.toml"
    plan.write_text(
        'name = "cut"\n[[fault]]\nkind = "cut"\ndirection = "commands"\n'
        "start_s = 0.1\nduration_s = 3600.0\n"
    )
    done = surefoot(
        *("run", scenario, "--inline", "--relay", plan, "--controller", "hold")
    )
    assert done.returncode == 1, done.stderr
    assert "stood" not in done.stdout
    lines = [line for line in done.stdout.splitlines() if "outcome" in line]
    assert "fault since 1.10 s: silence: no command for 1.0" in lines[0]
    assert "relay, cut" in done.stdout


def test_a_kept_run_has_its_relay_again(tmp_path: Path) -> None:
    scenario = sf.load_scenario(scenario_file(tmp_path, 0.05))
    run = sf.simulate(scenario=scenario, controller="hold", relay="loss-5")
    run.save(tmp_path / "run")
    again = sf.load_run(tmp_path / "run")
    assert again.plan.relay == run.plan.relay == shipped("loss-5")
    again.save(tmp_path / "copy")
    assert sf.load_run(tmp_path / "copy").plan.relay == run.plan.relay


def test_without_the_inertial_unit_the_stabilizer_holds_and_names_it(
    tmp_path: Path,
) -> None:
    done = relayed(run_plan(scenario_file(tmp_path, 0.4)), cut(["imu"], 3600.0))
    assert done.controller.end is EndReason.SENSOR_LOST
    assert done.controller.lost_sensors == {"imu": SensorTrouble.MISSING}
    assert done.plant.gate.mode is RobotMode.HOLD
    assert not done.plant.fell


def late_commands(ms: float) -> RelayPlan:
    """Return a plan that delays every command."""
    fault = {"kind": "delay", "direction": "commands", "ms": ms}
    return convert({"name": "late", "fault": [fault]}, RelayPlan, source="test")


def test_a_loop_too_slow_to_balance_with_ends_in_fault_and_says_so() -> None:
    """No single command is too old, and there is one in every tick."""
    plan = run_plan(Path("moving-platform-fast"))
    done = relayed(plan, late_commands(6.0))
    assert done.controller.end is EndReason.ROBOT_FAULT
    assert done.plant.gate.cause is ModeCause.LOOP_TOO_SLOW
    assert done.plant.refused.get("late", 0) == 0


def test_a_loop_slower_by_3_ms_balances(short_scenario: Path) -> None:
    plan = run_plan(short_scenario)
    done = relayed(plan, late_commands(3.0))
    assert done.controller.end is EndReason.RUN_OVER
    assert not done.plant.fell
