"""Lease and modes of the gate, and the consequences of silence."""

from __future__ import annotations

import pytest

from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import Refusal
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import ModeCause
from tests.robot_io.gate_at_work import (
    GATE,
    NOT_A_POSTURE,
    PERIOD_S,
    WALKER,
    active_gate,
    at_tick,
    offset,
)

# Who ------------------------------------------------------------------------------


def test_a_second_commander_is_refused_by_the_name_of_the_first() -> None:
    gate = active_gate()
    answer = gate.request("take", "bob", now_s=0.0)
    assert not answer.accepted
    assert answer.detail == "ann holds the lease, bob does not"
    assert at_tick(gate, 0, commander="bob").refusal is Refusal.LEASE
    assert at_tick(gate, 0, commander="").refusal is Refusal.LEASE
    assert at_tick(gate, 0).accepted


@pytest.mark.parametrize("action", ["release", "enable", "hold", "disable", "reset"])
def test_only_the_holder_may_ask(action: str) -> None:
    gate = active_gate()
    answer = gate.request(action, "bob", now_s=0.0)
    assert not answer.accepted
    assert "ann holds the lease" in answer.detail
    assert gate.mode is RobotMode.ACTIVE


def test_nobody_is_no_commander() -> None:
    gate = CommandGate(WALKER, WALKER.nominal)
    assert not gate.request("take", "", now_s=0.0).accepted
    answer = gate.request("enable", "", now_s=0.0)
    assert "nobody holds the lease" in answer.detail


def test_unknown_action_lists_the_known_ones() -> None:
    answer = active_gate().request("dance", "ann", now_s=0.0)
    assert "got action 'dance', expected take, release, enable" in answer.detail


def test_releasing_holds_and_lets_the_next_one_in() -> None:
    gate = active_gate()
    at_tick(gate, 3)
    assert gate.request("release", "ann", now_s=0.0).accepted
    assert gate.mode is RobotMode.HOLD
    assert gate.request("take", "bob", now_s=0.0).accepted
    assert gate.request("enable", "bob", now_s=0.0).accepted
    assert at_tick(gate, 4, commander="bob", sequence=0).accepted


def test_a_mode_is_reported_from_the_tick_in_which_it_began() -> None:
    gate = active_gate()
    at_tick(gate, 7)
    assert gate.request("hold", "ann", now_s=7.0 * PERIOD_S).accepted
    reports = [gate.report()]
    gate.begin_tick(now_s=8.0 * PERIOD_S)
    reports.append(gate.report())
    assert [report.mode for report in reports] == [RobotMode.HOLD, RobotMode.HOLD]
    assert reports[0].since_s == pytest.approx(7.0 * PERIOD_S)
    assert reports[1].since_s == pytest.approx(7.0 * PERIOD_S, abs=1.1 * PERIOD_S)


def test_a_silent_commander_loses_the_lease() -> None:
    gate = CommandGate(WALKER, WALKER.nominal)
    gate.request("take", "ann", now_s=0.0)
    gate.begin_tick(now_s=GATE.lease_s)
    assert gate.modes.lease.holder == "ann"
    gate.begin_tick(now_s=GATE.lease_s + PERIOD_S)
    assert gate.modes.lease.holder == ""
    assert gate.request("take", "bob", now_s=GATE.lease_s).accepted


def test_commanding_renews_the_lease() -> None:
    gate = active_gate()
    for tick in range(0, 3 * round(GATE.lease_s / PERIOD_S), 10):
        assert at_tick(gate, tick).accepted
    assert gate.modes.lease.holder == "ann"


def test_a_commander_that_is_gone_leaves_the_robot_holding() -> None:
    gate = active_gate()
    gate.modes.lose(ModeCause.COMMANDER_GONE, "ann is gone")
    assert gate.mode is RobotMode.HOLD
    assert gate.modes.lease.holder == ""


# Modes ----------------------------------------------------------------------------


def test_nothing_moves_before_enabling() -> None:
    gate = CommandGate(WALKER, WALKER.nominal)
    gate.request("take", "ann", now_s=0.0)
    assert at_tick(gate, 0).refusal is Refusal.MODE


def test_hold_then_enable_again() -> None:
    gate = active_gate()
    assert gate.request("hold", "ann", now_s=0.0).accepted
    assert at_tick(gate, 0).refusal is Refusal.MODE
    assert gate.request("enable", "ann", now_s=0.0).accepted
    assert at_tick(gate, 1).accepted


def test_off_is_left_through_hold_only() -> None:
    gate = active_gate()
    assert gate.request("disable", "ann", now_s=0.0).accepted
    assert gate.mode is RobotMode.OFF
    assert "ask for hold first" in gate.request("enable", "ann", now_s=0.0).detail
    assert gate.request("hold", "ann", now_s=0.0).accepted
    assert gate.request("enable", "ann", now_s=0.0).accepted


def test_e_stop_is_open_to_everyone_and_latches_until_reset() -> None:
    gate = active_gate()
    assert gate.modes.stop("a bystander").accepted
    for tick in range(3):
        assert at_tick(gate, tick).refusal is Refusal.MODE
    for action in ("enable", "hold", "disable"):
        assert not gate.request(action, "ann", now_s=0.0).accepted
        assert gate.mode is RobotMode.FAULT
    assert gate.modes.cause is ModeCause.ESTOP
    assert gate.modes.detail == "e-stop by a bystander"
    assert gate.request("reset", "ann", now_s=0.0).accepted
    assert gate.mode is RobotMode.HOLD
    assert gate.modes.cause is ModeCause.RESET


def test_e_stop_while_held_for_silence_cannot_be_commanded_away() -> None:
    gate = active_gate()
    at_tick(gate, 0)
    gate.begin_tick(now_s=2 * GATE.hold_after_s)
    gate.modes.stop("a bystander")
    assert at_tick(gate, 41).refusal is Refusal.MODE
    assert gate.mode is RobotMode.FAULT


def test_a_new_holder_does_not_go_on_where_a_silent_one_was_held() -> None:
    gate = active_gate()
    at_tick(gate, 0)
    gate.begin_tick(now_s=2 * GATE.hold_after_s)
    gate.request("release", "ann", now_s=0.1)
    gate.request("take", "bob", now_s=0.1)
    assert at_tick(gate, 100, commander="bob").refusal is Refusal.MODE


def test_reset_without_fault_is_declined() -> None:
    assert "no fault" in active_gate().request("reset", "ann", now_s=0.0).detail


# Silence --------------------------------------------------------------------------


def test_silence_leads_to_hold_then_to_fault() -> None:
    gate = active_gate()
    at_tick(gate, 0)
    gate.begin_tick(now_s=GATE.hold_after_s)
    assert gate.mode is RobotMode.ACTIVE
    gate.begin_tick(now_s=GATE.hold_after_s + PERIOD_S)
    assert gate.mode is RobotMode.HOLD
    assert gate.modes.cause is ModeCause.SILENCE
    assert gate.modes.detail == "no command for 0.021 s"
    gate.begin_tick(now_s=GATE.fault_after_s)
    assert gate.mode is RobotMode.HOLD
    gate.begin_tick(now_s=GATE.fault_after_s + PERIOD_S)
    assert gate.mode is RobotMode.FAULT
    assert gate.modes.cause is ModeCause.SILENCE
    assert gate.modes.detail == "no command for 1.001 s"


@pytest.mark.parametrize("start", range(0, 900, 100))
def test_a_silence_as_long_as_is_borne_is_borne_at_every_tick(start: int) -> None:
    """At 50 Hz one tick is 0.02 s; some ticks are that and a last bit apart."""
    gate = active_gate()
    ticks = round(GATE.hold_after_s / PERIOD_S)
    for tick in range(start, start + 100):
        assert at_tick(gate, tick).accepted
        gate.begin_tick(now_s=(tick + ticks) * PERIOD_S)
        assert gate.mode is RobotMode.ACTIVE


def test_refused_commands_do_not_feed_the_watchdog() -> None:
    gate = active_gate()
    at_tick(gate, 0)
    for tick in range(1, 40):
        at_tick(gate, tick, q=NOT_A_POSTURE)
    assert gate.mode is RobotMode.HOLD


def test_the_same_commander_goes_on_after_a_short_silence() -> None:
    gate = active_gate()
    at_tick(gate, 0)
    far = offset("left_knee", 0.5)
    assert at_tick(gate, 50, q=far).refusal is Refusal.FIRST_COMMAND
    assert gate.mode is RobotMode.HOLD
    assert at_tick(gate, 51).accepted
    assert gate.mode is RobotMode.ACTIVE
    assert gate.modes.cause is ModeCause.HEARD_AGAIN


def test_the_first_command_may_take_its_time_but_not_for_ever() -> None:
    gate = active_gate()
    gate.begin_tick(now_s=GATE.fault_after_s)
    assert gate.mode is RobotMode.ACTIVE
    gate.request("take", "ann", now_s=GATE.fault_after_s)  # keeps the lease alive
    gate.begin_tick(now_s=GATE.fault_after_s + PERIOD_S)
    assert gate.mode is RobotMode.HOLD
    assert gate.modes.cause is ModeCause.NO_FIRST_COMMAND
