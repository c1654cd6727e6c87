from __future__ import annotations

import dataclasses
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_io.gate import CommandGate
from robot_io.robot import Robot, load_robot
from robot_io.verdict import Limit, Refusal, Verdict
from schemas.arrays import Array
from schemas.codec import decode, encode
from schemas.messages import SCHEMA_VERSION, JointCommand, RobotMode, RobotStatus

WALKER = load_robot("walker")
GATE = WALKER.file.gate
PERIOD_S = WALKER.period_s
ROUNDING_RAD = 1e-12
NOT_A_POSTURE = np.full(WALKER.n_a, math.nan)


def command(q: Array, tick: int = 0, **changes: Any) -> JointCommand:
    """Joint command of ann that answers a tick; ``changes`` are fields of it."""
    fields: dict[str, Any] = {
        "schema": SCHEMA_VERSION,
        "tick": tick,
        "stamp_ns": 0,
        "q": np.asarray(q).tolist(),
        "commander": "ann",
        "sequence": tick,
    }
    return JointCommand(**{**fields, **changes})


def active_gate(robot: Robot = WALKER) -> CommandGate:
    """A gate that holds the nominal posture and listens to ann."""
    gate = CommandGate(robot, robot.nominal)
    assert gate.request("take", "ann", now_s=0.0).accepted
    assert gate.request("enable", "ann", now_s=0.0).accepted
    return gate


def at_tick(
    gate: CommandGate, tick: int, q: Array | None = None, **changes: Any
) -> Verdict:
    """Begins a tick and commands a posture, the present one if none is given."""
    gate.begin_tick(now_s=tick * PERIOD_S)
    wanted = gate.posture if q is None else q
    return gate.check(
        command(wanted, tick, **changes), tick=tick, now_s=tick * PERIOD_S
    )


def offset(joint: str, by_rad: float) -> Array:
    posture = WALKER.nominal.copy()
    posture[WALKER.joint_names.index(joint)] += by_rad
    return posture


# Values ---------------------------------------------------------------------------


wild_numbers = st.one_of(
    st.floats(-10.0, 10.0),
    st.floats(allow_nan=True, allow_infinity=True),
    st.just(1e308),
)
wild_postures = st.one_of(
    st.lists(wild_numbers, min_size=WALKER.n_a, max_size=WALKER.n_a),
    st.lists(wild_numbers, max_size=WALKER.n_a + 2),
)
commands = st.builds(
    JointCommand,
    schema=st.just(SCHEMA_VERSION),
    tick=st.integers(0, 40),
    stamp_ns=st.just(0),
    q=wild_postures,
    commander=st.sampled_from(["ann", "bob", ""]),
    sequence=st.integers(0, 60),
)


moves = st.one_of(
    st.floats(-0.04, 0.04).map(lambda size: np.full(WALKER.n_a, size)),
    st.integers(0, 2**32 - 1).map(
        lambda seed: np.random.default_rng(seed).normal(scale=0.05, size=WALKER.n_a)
    ),
    st.floats(-1e300, 1e300).map(lambda size: np.full(WALKER.n_a, size)),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(moves, st.booleans()), max_size=30))
def test_posture_stays_in_range_and_never_steps_further_than_allowed(
    wanted: list[tuple[Array, bool]],
) -> None:
    gate = active_gate()
    reach = np.minimum(GATE.step_limit_rad, WALKER.velocity_limit * PERIOD_S)
    assert at_tick(gate, 0).accepted
    tick, before = 0, gate.posture.copy()
    for sequence, (move, is_new_tick) in enumerate(wanted, start=1):
        if is_new_tick:
            tick, before = tick + 1, gate.posture.copy()
            gate.begin_tick(now_s=tick * PERIOD_S)
        each = command(gate.posture + move, tick, sequence=sequence)
        verdict = gate.check(each, tick=tick, now_s=tick * PERIOD_S)
        assert verdict.accepted or verdict.refusal is Refusal.NOT_FINITE
        assert np.all(np.abs(gate.posture - before) <= reach + ROUNDING_RAD)
        assert np.all(gate.posture >= WALKER.lower)
        assert np.all(gate.posture <= WALKER.upper)


@settings(max_examples=100, deadline=None)
@given(st.lists(commands, max_size=20))
def test_a_refused_command_moves_nothing(offered: list[JointCommand]) -> None:
    gate = active_gate()
    for tick, each in enumerate(offered):
        gate.begin_tick(now_s=tick * PERIOD_S)
        before = gate.posture.copy()
        verdict = gate.check(each, tick=tick, now_s=tick * PERIOD_S)
        assert verdict.accepted == (verdict.refusal is None)
        assert verdict.accepted or np.array_equal(gate.posture, before)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=WALKER.n_a, max_size=WALKER.n_a))
def test_commands_inside_the_limits_pass_unchanged(direction: list[float]) -> None:
    gate = active_gate()
    reach = np.minimum(GATE.step_limit_rad, WALKER.velocity_limit * PERIOD_S)
    q = np.clip(
        WALKER.nominal + reach * np.array(direction), WALKER.lower, WALKER.upper
    )
    gate.begin_tick(now_s=0.0)
    assert gate.check(command(q), tick=0, now_s=0.0) == Verdict(accepted=True)
    assert np.array_equal(gate.posture, q)
    assert not gate.clipped
    assert not gate.refused


@settings(max_examples=100, deadline=None)
@given(
    st.integers(0, WALKER.n_a - 1),
    st.sampled_from([math.nan, math.inf, -math.inf]),
)
def test_a_number_that_is_none_is_refused(joint: int, value: float) -> None:
    gate = active_gate()
    q = WALKER.nominal.copy()
    q[joint] = value
    assert at_tick(gate, 0, q=q).refusal is Refusal.NOT_FINITE
    assert np.array_equal(gate.posture, WALKER.nominal)


def test_wrong_number_of_joints_is_refused() -> None:
    gate = active_gate()
    verdict = at_tick(gate, 0, q=WALKER.nominal[:-1])
    assert verdict.refusal is Refusal.SIZE
    assert "got 27 numbers, expected 28" in gate.authority.reason


def test_too_fast_is_clipped_to_the_velocity_limit_and_counted() -> None:
    gate = active_gate()
    verdict = at_tick(gate, 0, q=offset("left_knee", 0.01))
    assert verdict == Verdict(accepted=True, clipped=(Limit.VELOCITY,))
    moved = gate.posture - WALKER.nominal
    knee = WALKER.joint_names.index("left_knee")
    assert moved[knee] == pytest.approx(WALKER.velocity_limit[knee] * PERIOD_S)
    assert gate.clipped == {"velocity": 1}
    assert "left_knee by 0.0020 rad" in gate.authority.reason


def test_a_jump_is_clipped_to_the_step_limit() -> None:
    gate = active_gate()
    verdict = at_tick(gate, 0, q=offset("left_knee", 0.04))
    assert verdict.clipped == (Limit.VELOCITY, Limit.STEP)


def test_outside_the_range_is_clipped_to_it() -> None:
    robot = dataclasses.replace(WALKER, upper=WALKER.nominal + 1e-3)
    gate = active_gate(robot)
    verdict = at_tick(gate, 0, q=offset("left_knee", 4e-3))
    assert verdict.clipped == (Limit.POSITION,)
    assert np.all(gate.posture <= robot.upper)


def test_limits_count_from_the_last_command_not_from_what_was_refused() -> None:
    gate = active_gate()
    assert at_tick(gate, 0, q=offset("left_knee", 0.004)).accepted
    assert not at_tick(gate, 1, q=NOT_A_POSTURE).accepted
    assert at_tick(gate, 2, q=offset("left_knee", 0.011)).clipped == ()


def test_two_commands_in_one_tick_move_as_far_as_one() -> None:
    gate = active_gate()
    q = offset("left_knee", 0.03)
    gate.begin_tick(now_s=0.0)
    gate.check(command(q, sequence=1), tick=0, now_s=0.0)
    after_one = gate.posture.copy()
    gate.check(command(q, sequence=2), tick=0, now_s=0.0)
    assert np.array_equal(gate.posture, after_one)


def test_first_command_far_from_the_held_posture_is_refused() -> None:
    gate = active_gate()
    q = offset("left_knee", GATE.first_command_tolerance_rad + 1e-3)
    assert at_tick(gate, 0, q=q).refusal is Refusal.FIRST_COMMAND
    assert "left_knee is 0.0510 rad from the held posture" in gate.authority.reason
    assert at_tick(gate, 1).accepted
    assert at_tick(gate, 2, q=q).accepted, "later ones are clipped instead"


def test_posture_cannot_be_written_from_outside() -> None:
    gate = active_gate()
    with pytest.raises(ValueError, match="read-only"):
        gate.posture[0] = 1.0


# Order ----------------------------------------------------------------------------


def test_a_replayed_or_older_command_is_refused() -> None:
    gate = active_gate()
    assert at_tick(gate, 5, sequence=5).accepted
    for sequence in (5, 4):
        verdict = at_tick(gate, 6, sequence=sequence)
        assert verdict.refusal is Refusal.SEQUENCE
    assert gate.refused == {"sequence": 2}


def test_an_answer_to_a_tick_long_ago_is_refused() -> None:
    gate = active_gate()
    assert GATE.max_command_age_s is not None
    oldest = math.ceil(GATE.max_command_age_s / PERIOD_S)
    gate.begin_tick(now_s=0.0)
    on_time = command(WALKER.nominal, 0, sequence=1)
    assert gate.check(on_time, tick=oldest, now_s=0.0).accepted
    late = command(WALKER.nominal, 0, sequence=2)
    assert gate.check(late, tick=oldest + 1, now_s=0.0).refusal is Refusal.LATE


def test_an_answer_to_a_tick_to_come_is_refused() -> None:
    gate = active_gate()
    gate.begin_tick(now_s=0.0)
    verdict = gate.check(command(WALKER.nominal, 3), tick=2, now_s=0.0)
    assert verdict.refusal is Refusal.FUTURE


# Who ------------------------------------------------------------------------------


def test_a_second_commander_is_refused_by_the_name_of_the_first() -> None:
    gate = active_gate()
    answer = gate.request("take", "bob", now_s=0.0)
    assert not answer.accepted
    assert answer.reason == "ann holds the lease, bob does not"
    assert at_tick(gate, 0, commander="bob").refusal is Refusal.LEASE
    assert at_tick(gate, 0, commander="").refusal is Refusal.LEASE
    assert at_tick(gate, 0).accepted


@pytest.mark.parametrize("action", ["release", "enable", "hold", "disable", "reset"])
def test_only_the_holder_may_ask(action: str) -> None:
    gate = active_gate()
    answer = gate.request(action, "bob", now_s=0.0)
    assert not answer.accepted
    assert "ann holds the lease" in answer.reason
    assert gate.mode is RobotMode.ACTIVE


def test_nobody_is_no_commander() -> None:
    gate = CommandGate(WALKER, WALKER.nominal)
    assert not gate.request("take", "", now_s=0.0).accepted
    answer = gate.request("enable", "", now_s=0.0)
    assert "nobody holds the lease" in answer.reason


def test_unknown_action_lists_the_known_ones() -> None:
    answer = active_gate().request("dance", "ann", now_s=0.0)
    assert "got action 'dance', expected take, release, enable" in answer.reason


def test_releasing_holds_and_lets_the_next_one_in() -> None:
    gate = active_gate()
    at_tick(gate, 3)
    assert gate.request("release", "ann", now_s=0.0).accepted
    assert gate.mode is RobotMode.HOLD
    assert gate.request("take", "bob", now_s=0.0).accepted
    assert gate.request("enable", "bob", now_s=0.0).accepted
    assert at_tick(gate, 4, commander="bob", sequence=0).accepted


def test_a_silent_commander_loses_the_lease() -> None:
    gate = CommandGate(WALKER, WALKER.nominal)
    gate.request("take", "ann", now_s=0.0)
    gate.begin_tick(now_s=GATE.lease_s)
    assert gate.authority.lease.holder == "ann"
    gate.begin_tick(now_s=GATE.lease_s + PERIOD_S)
    assert gate.authority.lease.holder == ""
    assert gate.request("take", "bob", now_s=GATE.lease_s).accepted


def test_commanding_renews_the_lease() -> None:
    gate = active_gate()
    for tick in range(0, 3 * round(GATE.lease_s / PERIOD_S), 10):
        assert at_tick(gate, tick).accepted
    assert gate.authority.lease.holder == "ann"


def test_a_commander_that_is_gone_leaves_the_robot_holding() -> None:
    gate = active_gate()
    gate.authority.lose("ann is gone")
    assert gate.mode is RobotMode.HOLD
    assert gate.authority.lease.holder == ""


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
    assert "ask for hold first" in gate.request("enable", "ann", now_s=0.0).reason
    assert gate.request("hold", "ann", now_s=0.0).accepted
    assert gate.request("enable", "ann", now_s=0.0).accepted


def test_e_stop_is_open_to_everyone_and_latches_until_reset() -> None:
    gate = active_gate()
    assert gate.authority.stop("a bystander").accepted
    for tick in range(3):
        assert at_tick(gate, tick).refusal is Refusal.MODE
    for action in ("enable", "hold", "disable"):
        assert not gate.request(action, "ann", now_s=0.0).accepted
        assert gate.mode is RobotMode.FAULT
    assert gate.authority.fault == "e-stop by a bystander"
    assert gate.request("reset", "ann", now_s=0.0).accepted
    assert gate.mode is RobotMode.HOLD
    assert gate.authority.fault == ""


def test_e_stop_while_held_for_silence_cannot_be_commanded_away() -> None:
    gate = active_gate()
    at_tick(gate, 0)
    gate.begin_tick(now_s=2 * GATE.hold_after_s)
    gate.authority.stop("a bystander")
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
    assert "no fault" in active_gate().request("reset", "ann", now_s=0.0).reason


# Silence --------------------------------------------------------------------------


def test_silence_leads_to_hold_then_to_fault() -> None:
    gate = active_gate()
    at_tick(gate, 0)
    gate.begin_tick(now_s=GATE.hold_after_s)
    assert gate.mode is RobotMode.ACTIVE
    gate.begin_tick(now_s=GATE.hold_after_s + PERIOD_S)
    assert gate.mode is RobotMode.HOLD
    assert "no command for 0.021 s" in gate.authority.reason
    gate.begin_tick(now_s=GATE.fault_after_s)
    assert gate.mode is RobotMode.HOLD
    gate.begin_tick(now_s=GATE.fault_after_s + PERIOD_S)
    assert gate.mode is RobotMode.FAULT
    assert "no command for 1.001 s" in gate.authority.fault


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


def test_the_first_command_may_take_its_time_but_not_for_ever() -> None:
    gate = active_gate()
    gate.begin_tick(now_s=GATE.fault_after_s)
    assert gate.mode is RobotMode.ACTIVE
    gate.begin_tick(now_s=GATE.fault_after_s + PERIOD_S)
    assert gate.mode is RobotMode.HOLD
    assert gate.authority.fault == ""


def test_status_tells_what_the_gate_does() -> None:
    gate = active_gate()

    def status() -> RobotStatus:
        return gate.status(tick=7, stamp_ns=8, now_s=0.5, deadline_misses=2)

    assert status().command_age_s == -1.0, "before the first command"
    at_tick(gate, 0)
    at_tick(gate, 0)
    gate.authority.stop("a bystander")
    told = status()
    assert (told.tick, told.stamp_ns, told.deadline_misses) == (7, 8, 2)
    assert told.mode is RobotMode.FAULT
    assert told.fault == "e-stop by a bystander"
    assert told.commander == "ann"
    assert told.command_age_s == 0.5
    assert told.refused == {"sequence": 1}
    assert told.q_command == WALKER.nominal.tolist()
    assert decode(encode(told), RobotStatus, joint_count=WALKER.n_a) == told


@settings(max_examples=100, deadline=None)
@given(st.lists(commands, max_size=40))
def test_every_refusal_is_counted_once(offered: list[JointCommand]) -> None:
    gate = active_gate()
    verdicts = []
    for tick, each in enumerate(offered):
        gate.begin_tick(now_s=tick * PERIOD_S)
        verdicts.append(gate.check(each, tick=tick, now_s=tick * PERIOD_S))
    refusals = [v.refusal for v in verdicts if v.refusal is not None]
    assert gate.refused == {r: refusals.count(r) for r in refusals}
    clips = [limit for v in verdicts for limit in v.clipped]
    assert gate.clipped == {limit: clips.count(limit) for limit in clips}


def test_a_smaller_step_limit_of_the_robot_file_is_kept() -> None:
    gate_file = msgspec.structs.replace(GATE, step_limit_rad=1e-3)
    robot = dataclasses.replace(
        WALKER, file=msgspec.structs.replace(WALKER.file, gate=gate_file)
    )
    gate = active_gate(robot)
    assert at_tick(gate, 0, q=offset("left_knee", 4e-3)).clipped == (Limit.STEP,)
    assert np.abs(gate.posture - WALKER.nominal).max() <= 1e-3 + ROUNDING_RAD
