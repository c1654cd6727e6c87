"""Settings of the gate in the robot file: age of commands, and limits."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import Limit, Refusal
from surefoot.schemas.messages import RobotMode
from tests.robot_io.gate_at_work import PERIOD_S, WALKER, active_gate, at_tick, command

BEYOND_RAD = 0.05
FIRST_S = 0.5


def walker_with(**settings: Any) -> Robot:
    """Return the Walker with changed gate settings."""
    gate = msgspec.structs.replace(WALKER.file.gate, **settings)
    file = msgspec.structs.replace(WALKER.file, gate=gate)
    return dataclasses.replace(WALKER, file=file)


def commanded_gate(robot: Robot) -> CommandGate:
    gate = active_gate(robot)
    assert at_tick(gate, 0).accepted
    return gate


@pytest.mark.parametrize(
    ("late_s", "is_accepted"), [(0.0, True), (0.019, True), (0.021, False)]
)
def test_a_command_too_old_by_the_clock_is_refused_though_its_tick_is_young(
    late_s: float, is_accepted: bool
) -> None:
    gate = active_gate(walker_with(max_command_age_s=None))  # as long as silence may be
    gate.begin_tick(now_s=FIRST_S, tick=7)
    verdict = gate.accept(command(WALKER.nominal, 7), tick=7, now_s=FIRST_S + late_s)
    assert verdict.accepted is is_accepted
    if not is_accepted:
        assert verdict.refusal is Refusal.LATE
        assert "sensors 0.021 s old" in gate.modes.notice


def test_the_robot_file_may_ask_for_younger_commands() -> None:
    gate = active_gate(walker_with(max_command_age_s=0.003))
    gate.begin_tick(now_s=0.0, tick=5)
    late = gate.accept(command(WALKER.nominal, 1), tick=5, now_s=0.0)
    assert late.refusal is Refusal.LATE
    in_time = gate.accept(command(WALKER.nominal, 2), tick=5, now_s=0.0)
    assert in_time.accepted


def test_a_gate_of_endless_patience_takes_no_endless_memory() -> None:
    gate = active_gate(walker_with(max_command_age_s=1e12))
    gate.begin_tick(now_s=0.0, tick=5)
    assert gate.accept(command(WALKER.nominal, 1), tick=5, now_s=0.0).accepted


def test_beyond_a_limit_is_refused_where_the_robot_file_says_so() -> None:
    gate = commanded_gate(walker_with(beyond_limits="refuse"))
    before = gate.posture.copy()
    verdict = at_tick(gate, 1, before + BEYOND_RAD)
    assert verdict.refusal is Refusal.LIMIT
    assert np.array_equal(gate.posture, before)
    assert gate.refused[Refusal.LIMIT] == 1
    assert gate.clipped[Limit.STEP] == 1
    assert "step" in gate.modes.notice


def test_refused_beyond_limits_for_long_is_silence() -> None:
    gate = commanded_gate(walker_with(beyond_limits="refuse"))
    for tick in range(1, 30):
        at_tick(gate, tick, WALKER.nominal + BEYOND_RAD)
    assert gate.mode is RobotMode.HOLD


def test_warn_only_follows_and_counts() -> None:
    gate = commanded_gate(walker_with(warn_only=True))
    wanted = gate.posture + BEYOND_RAD
    verdict = at_tick(gate, 1, wanted)
    assert verdict.accepted
    assert Limit.STEP in gate.clipped
    assert np.array_equal(gate.posture, wanted)
    assert "followed beyond its limits" in gate.modes.notice


def test_warn_only_still_refuses_what_is_no_posture_and_who_is_not_commanding() -> None:
    gate = commanded_gate(walker_with(warn_only=True))
    assert at_tick(gate, 1, np.full(WALKER.n_a, np.nan)).refusal is Refusal.NOT_FINITE
    assert at_tick(gate, 2, commander="bob").refusal is Refusal.LEASE
    assert np.array_equal(gate.posture, WALKER.nominal)


def test_times_of_old_ticks_are_not_taken_for_new_ones() -> None:
    gate = active_gate(walker_with(max_command_age_s=0.02))
    for tick in range(100):
        now_s = tick * PERIOD_S
        gate.begin_tick(now_s=now_s, tick=tick)
        oldest = max(0, tick - 20)
        verdict = gate.accept(
            command(WALKER.nominal, oldest, sequence=tick), tick=tick, now_s=now_s
        )
        assert verdict.accepted, gate.modes.notice
