"""The gate checks values, steps and order of commands."""

from __future__ import annotations

import dataclasses
import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.robot_io.robot_side.mode_machine import Limit, Refusal
from surefoot.schemas.arrays import Array
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    JointCommand,
    RobotMode,
    RobotStatus,
)
from tests.robot_io.gate_at_work import (
    GATE,
    NOT_A_POSTURE,
    PERIOD_S,
    ROUNDING_RAD,
    WALKER,
    active_gate,
    at_tick,
    command,
    offset,
)

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


@settings(max_examples=200)
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
        verdict = gate.accept(each, tick=tick, now_s=tick * PERIOD_S)
        assert verdict.accepted or verdict.refusal is Refusal.NOT_FINITE
        assert np.all(np.abs(gate.posture - before) <= reach + ROUNDING_RAD)
        assert np.all(gate.posture >= WALKER.lower)
        assert np.all(gate.posture <= WALKER.upper)


@settings(max_examples=100)
@given(st.lists(commands, max_size=40))
def test_a_refused_command_moves_nothing_and_is_counted_once(
    offered: list[JointCommand],
) -> None:
    gate = active_gate()
    verdicts = []
    for tick, each in enumerate(offered):
        gate.begin_tick(now_s=tick * PERIOD_S)
        before = gate.posture.copy()
        verdict = gate.accept(each, tick=tick, now_s=tick * PERIOD_S)
        assert verdict.accepted == (verdict.refusal is None)
        assert verdict.accepted or np.array_equal(gate.posture, before)
        verdicts.append(verdict)
    refusals = [v.refusal for v in verdicts if v.refusal is not None]
    assert gate.refused == {r: refusals.count(r) for r in refusals}


@settings(max_examples=100)
@given(st.lists(st.floats(-1.0, 1.0), min_size=WALKER.n_a, max_size=WALKER.n_a))
def test_commands_inside_the_limits_pass_unchanged(direction: list[float]) -> None:
    gate = active_gate()
    reach = np.minimum(GATE.step_limit_rad, WALKER.velocity_limit * PERIOD_S)
    q = np.clip(
        WALKER.nominal + reach * np.array(direction), WALKER.lower, WALKER.upper
    )
    gate.begin_tick(now_s=0.0)
    result = gate.accept(command(q), tick=0, now_s=0.0)
    assert result.accepted
    assert np.array_equal(result.posture, q)
    assert not gate.clipped
    assert not gate.refused


@settings(max_examples=100)
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
    assert "got 27 numbers, expected 28" in gate.modes.notice


def test_too_fast_is_clipped_to_the_velocity_limit_and_counted() -> None:
    gate = active_gate()
    verdict = at_tick(gate, 0, q=offset("left_knee", 0.01))
    assert verdict.accepted
    moved = verdict.posture - WALKER.nominal
    knee = WALKER.joint_names.index("left_knee")
    assert moved[knee] == pytest.approx(WALKER.velocity_limit[knee] * PERIOD_S)
    assert gate.clipped == {"velocity": 1}
    assert "left_knee by 0.0020 rad" in gate.modes.notice


def test_a_jump_is_clipped_to_the_step_limit() -> None:
    gate = active_gate()
    at_tick(gate, 0, q=offset("left_knee", 0.04))
    assert gate.clipped == {Limit.VELOCITY: 1, Limit.STEP: 1}


def test_outside_the_range_is_clipped_to_it() -> None:
    robot = dataclasses.replace(WALKER, upper=WALKER.nominal + 1e-3)
    gate = active_gate(robot)
    at_tick(gate, 0, q=offset("left_knee", 4e-3))
    assert gate.clipped == {Limit.POSITION: 1}
    assert np.all(gate.posture <= robot.upper)


def test_limits_count_from_the_last_command_not_from_what_was_refused() -> None:
    gate = active_gate()
    assert at_tick(gate, 0, q=offset("left_knee", 0.004)).accepted
    assert not at_tick(gate, 1, q=NOT_A_POSTURE).accepted
    assert at_tick(gate, 2, q=offset("left_knee", 0.011)).accepted
    assert not gate.clipped


def test_two_commands_in_one_tick_move_as_far_as_one() -> None:
    gate = active_gate()
    q = offset("left_knee", 0.03)
    gate.begin_tick(now_s=0.0)
    gate.accept(command(q, sequence=1), tick=0, now_s=0.0)
    after_one = gate.posture.copy()
    gate.accept(command(q, sequence=2), tick=0, now_s=0.0)
    assert np.array_equal(gate.posture, after_one)


def test_first_command_far_from_the_held_posture_is_refused() -> None:
    gate = active_gate()
    q = offset("left_knee", GATE.first_command_tolerance_rad + 1e-3)
    assert at_tick(gate, 0, q=q).refusal is Refusal.FIRST_COMMAND
    assert "left_knee is 0.0510 rad from the held posture" in gate.modes.notice
    assert at_tick(gate, 1).accepted
    assert at_tick(gate, 2, q=q).accepted, "later ones are clipped instead"


def test_posture_cannot_be_written_from_outside() -> None:
    gate = active_gate()
    for posture in (gate.posture, at_tick(gate, 0).posture, gate.posture):
        with pytest.raises(ValueError, match="read-only"):
            posture[0] = 1.0


def test_a_result_keeps_its_posture_whatever_comes_after_it() -> None:
    gate = active_gate()
    first = at_tick(gate, 0, q=offset("left_knee", 0.004))
    second = at_tick(gate, 1, q=offset("left_knee", 0.008))
    assert np.array_equal(first.posture, offset("left_knee", 0.004))
    assert np.array_equal(second.posture, offset("left_knee", 0.008))


def test_a_refusal_tells_to_follow_what_was_followed_before() -> None:
    gate = active_gate()
    followed = at_tick(gate, 0, q=offset("left_knee", 0.004))
    refused = at_tick(gate, 1, q=NOT_A_POSTURE)
    assert not refused.accepted
    assert np.array_equal(refused.posture, followed.posture)


def test_a_result_names_the_tick_its_command_answers() -> None:
    gate = active_gate()
    assert gate.accept(command(gate.posture, 3), tick=5, now_s=0.0).answers == 3


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
    assert gate.accept(on_time, tick=oldest, now_s=0.0).accepted
    late = command(WALKER.nominal, 0, sequence=2)
    assert gate.accept(late, tick=oldest + 1, now_s=0.0).refusal is Refusal.LATE


def test_an_answer_to_a_tick_to_come_is_refused() -> None:
    gate = active_gate()
    gate.begin_tick(now_s=0.0)
    verdict = gate.accept(command(WALKER.nominal, 3), tick=2, now_s=0.0)
    assert verdict.refusal is Refusal.FUTURE


# Counting -----------------------------------------------------------------------


def test_status_tells_what_the_gate_does() -> None:
    gate = active_gate()

    def status() -> RobotStatus:
        return gate.status(tick=7, stamp_ns=8, now_s=0.5, deadline_misses=2)

    assert status().command_age_s == -1.0, "before the first command"
    at_tick(gate, 0)
    at_tick(gate, 0)
    gate.modes.stop("a bystander")
    told = status()
    assert (told.tick, told.stamp_ns, told.deadline_misses) == (7, 8, 2)
    assert told.mode is RobotMode.FAULT
    assert told.detail == "e-stop by a bystander"
    assert told.commander == "ann"
    assert told.command_age_s == 0.5
    assert told.refused == {"sequence": 1}
    assert told.q_command == WALKER.nominal.tolist()
    assert decode(encode(told), RobotStatus, joint_count=WALKER.n_a) == told


def test_a_smaller_step_limit_of_the_robot_file_is_kept() -> None:
    gate_file = msgspec.structs.replace(GATE, step_limit_rad=1e-3)
    robot = dataclasses.replace(
        WALKER, file=msgspec.structs.replace(WALKER.file, gate=gate_file)
    )
    gate = active_gate(robot)
    at_tick(gate, 0, q=offset("left_knee", 4e-3))
    assert gate.clipped == {Limit.STEP: 1}
    assert np.abs(gate.posture - WALKER.nominal).max() <= 1e-3 + ROUNDING_RAD
