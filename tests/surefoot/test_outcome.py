"""The outcome of a run, from the results of both sides."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from rich.console import Console

from surefoot.cli.summary import run_table
from surefoot.errors import ExitCode, exit_code_for
from surefoot.outcome import Sides, join_result, judge
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.run_plan import make_plan
from surefoot.runs import run_inline
from surefoot.schemas.messages import Reference, RobotMode
from surefoot.schemas.reasons import EndReason, FallCriterion, ModeCause, Outcome
from surefoot.schemas.result import (
    COMMANDED,
    NO_TIME,
    ControllerResult,
    ModeReport,
    PlantResult,
    WalkReport,
)
from surefoot.schemas.settings import ControllerSettings
from surefoot.simulation import Simulation
from surefoot.stabilizer.controller import ControllerOutput, HoldController
from surefoot.studies.cell import Cell, Group
from surefoot.studies.store import Task
from surefoot.studies.summaries import summarise

TICKS, PERIOD_S = 1000, 0.001
PLANT = PlantResult(
    fell=False,
    fell_at_s=None,
    fall=None,
    fall_detail="",
    end=ModeCause.RUN_OVER,
    end_detail="1 s",
    gate=COMMANDED,
    duration_s=1.0,
    com_error_rms_mm=None,
    com_error_max_mm=None,
    base_tilt_max_deg=0.0,
    force_deviation_rms_n=None,
    force_peak_n=[1.0, 1.0],
    contact_lost_s=[0.0, 0.0],
    contact_gap_s=[0.0, 0.0],
    real_time_factor=1.0,
    round_trip_ms=NO_TIME,
    period_jitter_ms=NO_TIME,
    deadline_misses=0,
    ticks=TICKS,
    refused={},
    clipped={},
    log_sha256="",
)
CONTROLLER = ControllerResult(
    ticks=TICKS,
    tick_ms=NO_TIME,
    force_error_rms_n=[0.0, 0.0],
    qp_failures=0,
    stale_snapshots=0,
    degraded_ticks=0,
    lost_sensors={},
    balancing_ticks=700,
    balancing_failures=0,
    end=EndReason.RUN_OVER,
    end_detail="1 s",
)


def gate(mode: RobotMode, cause: ModeCause, detail: str = "words") -> ModeReport:
    return ModeReport(mode=mode, cause=cause, detail=detail, since_s=0.5)


HELD = gate(RobotMode.HOLD, ModeCause.RELEASED)
SILENT = gate(RobotMode.FAULT, ModeCause.SILENCE)
SLOW = gate(RobotMode.FAULT, ModeCause.LOOP_TOO_SLOW)
FELL = {
    "fell": True,
    "fell_at_s": 0.9,
    "fall": FallCriterion.TILT,
    "fall_detail": "the base leans by 61 deg",
    "end": ModeCause.FELL,
}
CASES: list[tuple[dict[str, Any], dict[str, Any], Outcome]] = [
    ({}, {}, Outcome.STOOD),
    (FELL, {}, Outcome.FELL),
    ({**FELL, "gate": SILENT}, {}, Outcome.FELL),
    ({"gate": SILENT}, {"end": EndReason.ROBOT_FAULT}, Outcome.FAULT),
    ({"gate": HELD}, {"end": EndReason.SENSOR_LOST}, Outcome.HELD),
    ({}, {"end": EndReason.FELL}, Outcome.HELD),
    ({"gate": HELD}, {"end": EndReason.LEASE_LOST}, Outcome.HELD),
    ({"end": ModeCause.STOPPED}, {}, Outcome.INTERRUPTED),
    ({"gate": HELD}, {"end": EndReason.STOPPED}, Outcome.INTERRUPTED),
    ({"end": ModeCause.NO_COMMANDER}, {"ticks": 0}, Outcome.NOT_CONTROLLED),
    ({}, {"ticks": 0}, Outcome.NOT_CONTROLLED),
    ({}, {"balancing_failures": 350}, Outcome.STOOD),
    ({}, {"balancing_failures": 351}, Outcome.NOT_CONTROLLED),
    ({"gate": HELD}, {"balancing_failures": 700}, Outcome.NOT_CONTROLLED),
    ({"refused": {"late": 500}}, {}, Outcome.STOOD),
    ({"refused": {"late": 300, "size": 201}}, {}, Outcome.NOT_CONTROLLED),
]


@pytest.mark.parametrize(("plant", "controller", "expected"), CASES)
def test_the_rules(
    plant: dict[str, Any], controller: dict[str, Any], expected: Outcome
) -> None:
    found = judge(
        msgspec.structs.replace(PLANT, **plant),
        msgspec.structs.replace(CONTROLLER, **controller),
        period_s=PERIOD_S,
    )
    assert found.outcome is expected
    assert found.detail


@pytest.mark.parametrize("outcome", Outcome)
def test_only_stood_and_walked_are_successes(outcome: Outcome) -> None:
    code = exit_code_for(outcome)
    assert (code is ExitCode.OK) == outcome.is_up
    assert outcome.is_up == (outcome in ("stood", "walked"))
    assert (code == 5) == (outcome is Outcome.FELL)
    assert (code == 130) == (outcome is Outcome.INTERRUPTED)


@pytest.mark.parametrize(
    ("report", "misses", "is_realtime", "is_slow"),
    [
        (SLOW, 0, True, True),
        (SILENT, 60, True, True),
        (SILENT, 20, True, False),
        (SILENT, 60, False, False),
    ],
)
def test_in_real_time_a_slow_machine_is_named_as_the_cause(
    report: ModeReport, misses: int, is_realtime: bool, is_slow: bool
) -> None:
    plant = msgspec.structs.replace(PLANT, gate=report, deadline_misses=misses)
    found = judge(plant, CONTROLLER, is_realtime=is_realtime, period_s=PERIOD_S)
    share = round(100 * misses / 500)
    slow = f"machine too slow: {share} % of commands late"
    assert (found.detail == f"since 0.50 s: {slow}") == is_slow


def test_a_fall_says_by_what_one_knows_and_what_was_before() -> None:
    plant = msgspec.structs.replace(PLANT, **{**FELL, "gate": SILENT})
    assert judge(plant, CONTROLLER, period_s=PERIOD_S).sentence == (
        "fell at 0.90 s: the base leans by 61 deg; fault since 0.50 s, silence: words"
    )


def test_a_fall_after_the_stabilizer_gave_up_says_why_it_did() -> None:
    plant = msgspec.structs.replace(PLANT, **{**FELL, "gate": HELD})
    gave_up = msgspec.structs.replace(
        CONTROLLER, end=EndReason.SENSOR_LOST, end_detail="imu"
    )
    assert judge(plant, gave_up, period_s=PERIOD_S).detail == (
        "at 0.90 s: the base leans by 61 deg; hold since 0.50 s, sensor lost: imu"
    )


class Unsolved(HoldController):
    """A controller all of whose QPs fail in all ticks."""

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        output = super().step(snapshot, reference)
        output.wrench_qp = "infeasible"
        return output


def test_a_robot_that_stands_by_itself_has_not_been_controlled(
    short_scenario: Path,
) -> None:
    plan = make_plan(
        str(short_scenario),
        controller="hold",
        overrides=["estimator.calibration_s=0.1"],
    )
    result = run_inline(plan, controller=Unsolved(plan.robot.n_a)).result
    assert result.outcome is Outcome.NOT_CONTROLLED
    assert not result.fell
    assert "no solution of the QPs in 200 of 200 ticks" in result.outcome_detail


def test_in_a_study_it_does_not_count_as_up(
    monkeypatch: pytest.MonkeyPatch, short_scenario: Path
) -> None:
    def make(name: str, robot: Robot, settings: ControllerSettings) -> Unsolved:
        return Unsolved(robot.n_a)

    monkeypatch.setattr("surefoot.stabilizer.factory.make_controller", make)
    cell = Cell(Group(str(short_scenario), (), "hold", "ideal"), seed=0)
    row = Task(cell, "walker", ("estimator.calibration_s=0.1",)).run()
    assert row["outcome"] == "not_controlled"
    (summary,) = summarise([row]).values()
    assert (summary.runs, summary.up) == (1, 0)


def test_a_simulation_that_is_not_run_to_its_end_is_interrupted(
    short_scenario: Path,
) -> None:
    sim = Simulation(scenario=short_scenario)
    controller = HoldController(sim.robot.n_a)
    for _ in range(3):
        sim.step(controller)
    assert sim.result().outcome is Outcome.INTERRUPTED


@pytest.mark.parametrize("left", [CONTROLLER, None], ids=["figures", "none"])
def test_a_run_without_a_tick_is_told_without_figures(
    left: ControllerResult | None, capsys: pytest.CaptureFixture[str]
) -> None:
    stopped = msgspec.structs.replace(
        PLANT, ticks=0, duration_s=0.0, end=ModeCause.STOPPED, end_detail="SIGINT"
    )
    if left is not None:
        left = msgspec.structs.replace(left, ticks=0, end=EndReason.STOPPED)
    result = join_result(make_plan("standing"), Sides(stopped, left))
    Console(width=100).print(run_table(result))
    shown = capsys.readouterr().out
    assert "interrupted at 0 s: SIGINT" in shown
    assert not any(word in shown for word in ("tilt", "peak", "QP", "0.0,", "none"))


@pytest.mark.parametrize(
    ("changes", "outcome", "words"),
    [
        ({}, Outcome.WALKED, "4 steps"),
        ({"steps_done": 3}, Outcome.STOOD, "3 of 4 steps"),
        (
            {"is_over": False},
            Outcome.STOOD,
            "4 of 4 steps taken: still walking at the end",
        ),
        (
            {"steps_done": 3},
            Outcome.STOOD,
            "3 of 4 steps taken: the rest was not begun",
        ),
        ({"steps_done": 0}, Outcome.STOOD, "0 of 4 steps taken: no step was begun"),
        (
            {"steps_done": 0, "steps_planned": 0},
            Outcome.STOOD,
            "0 of 0 steps taken: there was no time for a step",
        ),
        ({"refusal": "too far"}, Outcome.STOOD, "too far"),
    ],
)
def test_only_who_takes_all_steps_and_stands_has_walked(
    changes: dict[str, Any], outcome: Outcome, words: str
) -> None:
    whole = WalkReport(
        steps_done=4,
        steps_planned=4,
        is_over=True,
        dcm_error_rms_mm=[1.0, 2.0],
        dcm_error_max_mm=[3.0, 4.0],
        placement_error_max_mm=5.0,
        touchdown_late_s=[0.0, 0.0],
    )
    walk = msgspec.structs.replace(whole, **changes)
    controller = msgspec.structs.replace(CONTROLLER, walk=walk)
    judgement = judge(PLANT, controller, period_s=PERIOD_S)
    assert judgement.outcome is outcome
    assert words in judgement.detail


OF_STANDING = ("CoM error", "contact lost")


def test_a_walk_is_shown_with_what_counts_of_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    result = join_result(make_plan("standing"), Sides(PLANT, CONTROLLER))
    Console(width=100).print(run_table(result))
    stood = capsys.readouterr().out
    assert "DCM" not in stood
    assert all(name in stood for name in OF_STANDING)
    walked = msgspec.structs.replace(
        result,
        steps_done=3,
        dcm_error_rms_mm=[1.25, 2.5],
        dcm_error_max_mm=[4.0, 5.0],
        placement_error_max_mm=6.5,
        touchdown_peak_n=[500.0, 612.5],
    )
    Console(width=100).print(run_table(walked))
    shown = capsys.readouterr().out
    for figure in ("1.2, 2.5 mm", "4.0, 5.0 mm", "6.5 mm", "500.0, 612.5 N"):
        assert figure in shown
    assert not any(name in shown for name in OF_STANDING)
