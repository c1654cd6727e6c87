"""Thousands of hostile commands reach no servo of a running robot."""

from __future__ import annotations

import signal
from collections import Counter
from itertools import cycle

import numpy as np

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.channel import TOKEN_BYTES, Latest
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.codec import decode_fields, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError, SchemaVersionError
from surefoot.schemas.messages import SCHEMA_VERSION, JointCommand, RobotStatus
from surefoot.schemas.topics import topic
from tests.nodes.processes import robot, running, stabilizer
from tests.nodes.test_nodes import NOISE, in_one_process, is_running
from tests.support import PATIENCE_S, wait_until

WALKER = load_robot("walker")
COUNT = 2_000
BATCH = 200
"""Fewer than the robot's inbox holds, so that each command is judged."""
TABLE = {"duration_s": 600.0, "sensors": NOISE}
"""The run is ended when the last command has been judged."""


def hostile_commands(heard: bytes) -> list[bytes]:
    """Return random, extreme and replayed commands, and those of other senders.

    Args:
        heard: a command of the commander that was followed.
    """
    rng = np.random.default_rng(0)
    followed = decode_fields(heard, JointCommand)
    common = {
        "stamp_ns": followed.stamp_ns,
        "tick": followed.tick,
        "sequence": followed.sequence + 10**6,
    }

    def command(q: np.ndarray, *, schema: int, commander: str) -> bytes:
        return encode(
            JointCommand(schema=schema, q=q.tolist(), commander=commander, **common)
        )

    def mutated() -> bytes:
        data = bytearray(
            command(WALKER.nominal, schema=SCHEMA_VERSION, commander="bob")
        )
        data[rng.integers(len(data))] = rng.integers(256)
        return bytes(data)

    def wild() -> np.ndarray:
        return rng.normal(size=WALKER.n_a) * 10.0 ** rng.integers(-3, 300)

    nothing = np.full(WALKER.n_a, np.nan)
    kinds = cycle(
        (
            lambda: rng.bytes(int(rng.choice([0, TOKEN_BYTES, 5000, 100, 300]))),
            mutated,
            lambda: command(wild(), schema=SCHEMA_VERSION, commander="bob"),
            lambda: command(nothing, schema=SCHEMA_VERSION, commander="ann"),
            lambda: command(wild(), schema=SCHEMA_VERSION + 1, commander="ann"),
            lambda: heard,
        )
    )
    return [next(kinds)() for _ in range(COUNT)]


def why_refused(data: bytes) -> str:
    """Return the reason that the robot must count for a hostile command."""
    try:
        command = decode_fields(data, JointCommand)
    except SchemaVersionError:
        return "schema"
    except MessageError:
        return "malformed"
    if command.commander != "ann":
        return "lease"
    return "sequence" if np.isfinite(command.q).all() else "not_finite"


def test_no_hostile_command_reaches_a_servo_and_each_is_counted(
    endpoints: Endpoints,
) -> None:
    with (
        running(robot, endpoints, TABLE, Pace.LOCKSTEP) as plant,
        Bus(endpoints, Role.CLIENT, namespace="walker", timeout_s=PATIENCE_S) as bus,
    ):
        statuses = Latest(bus.channel(topic("status").key, depth=1), RobotStatus)
        commands = bus.channel("cmd/joints", depth=1)
        publisher = bus.publisher("cmd/joints", urgent=True)
        wait_until(lambda: publisher.matching_status.matching, what="the robot")

        def refused() -> int:
            status = statuses.poll()
            return sum(status.refused.values()) if status else 0

        with running(stabilizer, endpoints, Pace.LOCKSTEP) as controller:
            wait_until(
                lambda: (status := statuses.poll()) and is_running(status),
                what="the run",
            )
            heard = wait_until(commands.poll, what="a command")
            assert heard is not None
            hostile = hostile_commands(heard)
            for end in range(BATCH, COUNT + 1, BATCH):
                for data in hostile[end - BATCH : end]:
                    publisher.put(data)
                wait_until(lambda end=end: refused() >= end, what=f"{end} refusals")
            plant.signal(signal.SIGTERM)
            answered = controller.result()
        run = plant.result()
    assert run.refused == Counter(map(why_refused, hostile))
    kinds = {"malformed", "schema", "lease", "sequence", "not_finite"}
    assert set(run.refused) == kinds
    assert run.clipped == {}
    assert run.deadline_misses == 0
    assert answered.ticks == run.ticks
    as_long = {"duration_s": run.ticks * WALKER.period_s}
    assert run.log_sha256 == in_one_process(TABLE | as_long)
