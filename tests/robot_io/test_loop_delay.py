"""A loop whose answers are too late on average leads to a fault."""

from __future__ import annotations

import math

import msgspec
import pytest

from surefoot.robot_io.robot_side.gate import AVERAGED_OVER_S, CommandGate, LoopDelay
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.robot_file import Gate
from tests.robot_io.gate_at_work import GATE, PERIOD_S, active_gate, command

SECONDS = 3.0
LIMIT_S = GATE.max_loop_delay_s or math.inf


def ticks_until_fault(gate: CommandGate, *, age: int, every: int = 1) -> int | None:
    """Return the ticks until a fault with commands this old; None without a fault."""
    for tick in range(round(SECONDS / PERIOD_S)):
        now_s = tick * PERIOD_S
        gate.begin_tick(now_s=now_s, tick=tick)
        if gate.mode is RobotMode.FAULT:
            return tick
        if tick >= age and tick % every == 0:
            verdict = gate.accept(
                command(gate.posture, tick - age), tick=tick, now_s=now_s
            )
            assert verdict.accepted, gate.modes.notice
    return None


def test_the_walker_watches_the_delay_of_its_loop() -> None:
    assert LIMIT_S < (GATE.max_command_age_s or 0.0) < GATE.hold_after_s


@pytest.mark.parametrize(("age", "every"), [(0, 1), (2, 1), (3, 1), (0, 4), (1, 4)])
def test_a_loop_fast_enough_is_no_fault(age: int, every: int) -> None:
    assert ticks_until_fault(active_gate(), age=age, every=every) is None


@pytest.mark.parametrize("age", [4, 6, 8])
def test_a_loop_too_slow_is_a_fault_when_its_average_says_so(age: int) -> None:
    gate = active_gate()
    seen_s = age * PERIOD_S
    counted_s = min(seen_s, GATE.max_command_age_s or seen_s)
    expected_s = -AVERAGED_OVER_S * math.log(1.0 - LIMIT_S / counted_s)
    tick = ticks_until_fault(gate, age=age)
    assert tick is not None
    assert tick * PERIOD_S == pytest.approx(expected_s, rel=0.05)
    assert gate.modes.detail == (
        "commands answered sensors over 3.5 ms old on average: the loop is too slow"
    )


def test_few_commands_are_as_bad_as_old_ones() -> None:
    """One new command in ten ticks, each of them fresh: 4.5 ms old on average."""
    assert ticks_until_fault(active_gate(), age=0, every=10) is not None


def test_a_silence_is_for_the_watchdog_alone() -> None:
    gate = active_gate()
    modes = [RobotMode.ACTIVE]
    for tick in range(1000):
        now_s = tick * PERIOD_S
        gate.begin_tick(now_s=now_s, tick=tick)
        if not 100 <= tick < 300:
            gate.accept(command(gate.posture, tick), tick=tick, now_s=now_s)
        if gate.mode is not modes[-1]:
            modes.append(gate.mode)
    assert modes == [RobotMode.ACTIVE, RobotMode.HOLD, RobotMode.ACTIVE]
    assert gate.delay.mean_s < 0.5 * LIMIT_S


def test_enabling_begins_a_new_average() -> None:
    gate = active_gate()
    assert ticks_until_fault(gate, age=6) is not None
    assert gate.delay.mean_s > LIMIT_S
    for action in ("reset", "enable"):
        assert gate.request(action, "ann", now_s=SECONDS).accepted
    assert gate.delay.mean_s == 0.0


def test_nothing_is_counted_before_the_first_command() -> None:
    delay = LoopDelay(period_s=PERIOD_S, oldest=8)
    for tick in range(1000):
        delay.count(tick)
    assert delay.mean_s == 0.0


def test_a_robot_file_without_the_limit_does_not_watch() -> None:
    assert msgspec.convert({"step_limit_rad": 0.02}, Gate).max_loop_delay_s is None
