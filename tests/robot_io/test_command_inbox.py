"""Commands on their way through the gate, without a bus."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from surefoot.robot_io.robot_side.mode_machine import CommandResult, Refusal
from surefoot.robot_io.robot_side.server import CommandInbox, NoAnswer
from surefoot.schemas.codec import encode
from surefoot.schemas.messages import SCHEMA_VERSION
from tests.robot_io.gate_at_work import PERIOD_S, WALKER, active_gate, command, offset

INTERRUPT = None


class ScriptedChannel:
    """Returns what was put into it, in order; None ends a wait."""

    def __init__(self, *payloads: bytes | None) -> None:
        self.payloads = deque(payloads)

    def poll(self) -> bytes | None:
        return self.payloads.popleft() if self.payloads else None

    def wait(self, deadline: float) -> bytes | None:
        return self.poll()


class Robot:
    """A gate and its inbox at a tick."""

    def __init__(self, *payloads: bytes | None) -> None:
        self.channel = ScriptedChannel(*payloads)
        self.gate = active_gate()
        self.inbox = CommandInbox(self.channel, self.gate)

    def answer(self, tick: int, *, newest: int) -> CommandResult | NoAnswer:
        self.gate.begin_tick(now_s=newest * PERIOD_S, tick=newest)
        return self.inbox.answer(
            tick, newest_tick=newest, now_s=newest * PERIOD_S, deadline=0.0
        )


def wire(tick: int, by_rad: float = 0.0, **changes: object) -> bytes:
    return encode(command(offset("left_knee", by_rad), tick, **changes))


def test_the_answer_carries_its_tick_and_the_posture_to_follow() -> None:
    result = Robot(wire(0, 0.002)).answer(0, newest=0)
    assert isinstance(result, CommandResult)
    assert result.accepted
    assert result.answers == 0
    assert np.array_equal(result.posture, offset("left_knee", 0.002))


@pytest.mark.parametrize(
    ("q", "refusal"),
    [
        ([math.nan] * WALKER.n_a, Refusal.NOT_FINITE),
        ([math.inf] * WALKER.n_a, Refusal.NOT_FINITE),
        ([0.0] * (WALKER.n_a - 1), Refusal.SIZE),
        (offset("left_knee", 1.0), Refusal.FIRST_COMMAND),
    ],
)
def test_an_answer_that_is_refused_is_an_answer(
    q: list[float], refusal: Refusal
) -> None:
    """In one process, too, nobody waits for another one."""
    result = Robot(encode(command(np.array(q), 0))).answer(0, newest=0)
    assert isinstance(result, CommandResult)
    assert result.refusal is refusal
    assert np.array_equal(result.posture, WALKER.nominal)


def test_a_wait_that_is_broken_off_can_be_taken_up_again() -> None:
    robot = Robot(INTERRUPT, wire(0, 0.002))
    assert robot.answer(0, newest=0) is NoAnswer.YET
    result = robot.answer(0, newest=0)
    assert isinstance(result, CommandResult)
    assert result.answers == 0


def test_older_answers_are_taken_in_on_the_way() -> None:
    robot = Robot(wire(0, 0.002), wire(1, 0.004))
    result = robot.answer(1, newest=1)
    assert isinstance(result, CommandResult)
    assert result.answers == 1
    assert not robot.gate.refused


def test_a_lost_answer_is_not_waited_for_and_the_one_after_it_is_kept() -> None:
    robot = Robot(wire(1, 0.002))
    assert robot.answer(0, newest=1) is NoAnswer.OVERTAKEN
    assert robot.channel.poll() is None
    result = robot.answer(1, newest=1)
    assert isinstance(result, CommandResult)
    assert np.array_equal(result.posture, offset("left_knee", 0.002))


def test_somebody_elses_command_and_a_replay_do_not_end_the_wait() -> None:
    robot = Robot(
        wire(0, 0.002),
        wire(1, 0.004, commander="eve"),
        wire(1, 0.004, sequence=0),
        wire(1, 0.003),
    )
    assert isinstance(robot.answer(0, newest=0), CommandResult)
    result = robot.answer(1, newest=1)
    assert isinstance(result, CommandResult)
    assert np.array_equal(result.posture, offset("left_knee", 0.003))
    assert robot.gate.refused == {"lease": 1, "sequence": 1}


def test_of_the_newest_the_last_one_accepted_counts() -> None:
    robot = Robot(
        wire(0, 0.001, sequence=1),
        wire(0, 0.002, sequence=2),
        wire(0, 0.003, sequence=0),
        b"nonsense",
        wire(0, 0.004, sequence=3, schema=SCHEMA_VERSION + 1),
    )
    robot.gate.begin_tick(now_s=0.0, tick=0)
    result = robot.inbox.newest(0, now_s=0.0)
    assert result is not None
    assert np.array_equal(result.posture, offset("left_knee", 0.002))
    assert robot.gate.refused == {"sequence": 1, "malformed": 1, "schema": 1}
    assert robot.inbox.newest(0, now_s=0.0) is None
