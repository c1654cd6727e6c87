"""Hostile and broken commands over real Zenoh: counted, and without effect."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.client_side.client import RobotClient
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    JointCommand,
    RobotMode,
)
from tests.robot_io.client_at_work import (
    WALKER,
    mode_of,
    posture_of,
    refused_by,
)
from tests.robot_io.served_robot import ServedRobot
from tests.support import wait_until


@pytest.fixture
def raw_command(served: ServedRobot, endpoints: Endpoints) -> Iterator[Callable]:
    """Put any bytes on the command key."""
    with Bus(endpoints, Role.CLIENT, namespace="walker") as peer:
        publisher = peer.publisher("cmd/joints", urgent=True)
        wait_until(lambda: publisher.matching_status.matching, what="the robot")
        yield publisher.put


def joint_command(**changes: object) -> JointCommand:
    command = JointCommand(
        schema=SCHEMA_VERSION,
        tick=0,
        stamp_ns=0,
        q=WALKER.nominal.tolist(),
        commander="ann",
        sequence=10**6,
    )
    return msgspec.structs.replace(command, **changes)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "malformed"),
        (b"\xff" * 16, "malformed"),
        (b"x" * 5000, "malformed"),
        (encode(joint_command(q=WALKER.nominal[1:].tolist())), "size"),
        (encode(joint_command(q=[float("nan")] * WALKER.n_a)), "not_finite"),
        (encode(joint_command(schema=SCHEMA_VERSION + 1)), "schema"),
        (encode(joint_command(commander="bob")), "lease"),
        (encode(joint_command(tick=5000)), "future"),
        (encode(joint_command(q=(WALKER.nominal + 9.0).tolist())), "first_command"),
    ],
    ids=[
        "empty", "as long as a token", "long", "short of a joint", "nan",
        "other version", "other commander", "tick to come", "far away",
    ],
)  # fmt: skip
def test_bad_commands_are_counted_under_their_reason_and_move_nothing(
    served: ServedRobot,
    commander: RobotClient,
    raw_command: Callable[[bytes], None],
    data: bytes,
    reason: str,
) -> None:
    served.publish_tick()
    raw_command(data)
    wait_until(lambda: refused_by(served) == {reason: 1}, what=f"{reason} refused")
    assert np.array_equal(posture_of(served), WALKER.nominal)
    assert mode_of(served) is RobotMode.ACTIVE


def test_a_thousand_bad_commands_leave_the_commander_undisturbed(
    served: ServedRobot, commander: RobotClient, raw_command: Callable[[bytes], None]
) -> None:
    rng = np.random.default_rng(0)
    good = bytearray(encode(joint_command(commander="bob")))
    count = 1000
    for index in range(count):
        data = good.copy()
        data[rng.integers(len(data))] = rng.integers(256)
        raw_command(bytes(data))
        if index % 100 == 0:
            commander.send(WALKER.nominal, tick=served.publish_tick())
        done = index + 1
        wait_until(
            lambda done=done: sum(refused_by(served).values()) == done,
            what=f"{done} refusals",
        )
    assert np.array_equal(posture_of(served), WALKER.nominal)
    assert mode_of(served) is RobotMode.ACTIVE
    assert set(refused_by(served)) <= {"malformed", "schema", "lease"}


def test_a_replayed_command_is_refused(
    served: ServedRobot, commander: RobotClient, raw_command: Callable[[bytes], None]
) -> None:
    tick = served.publish_tick()
    data = encode(joint_command(tick=tick))
    raw_command(data)
    raw_command(data)
    wait_until(lambda: refused_by(served) == {"sequence": 1}, what="the refusal")
