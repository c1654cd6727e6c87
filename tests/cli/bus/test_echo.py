from __future__ import annotations

import json

import pytest

from surefoot.schemas.endpoints import Endpoints
from tests.cli.bus.conftest import Ask
from tests.cli.bus.talking_robot import Say, force_torque, talking_robot
from tests.command import Surefoot

MALFORMED_EVERY = 3


def say(count: int, tell: Say) -> None:
    good = count % MALFORMED_EVERY != 0
    tell("state/ft/left_ankle", force_torque(count) if good else b"\xc1")


@pytest.mark.parametrize("name", ["left_ankle_ft", "/walker/state/ft/left_ankle"])
def test_messages_and_malformed_ones_as_json(
    ask: Ask, endpoints: Endpoints, name: str
) -> None:
    with talking_robot(endpoints, say):
        done = ask("echo", name, "--count", 6, "--json")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == 6
    bad = [line for line in lines if "malformed" in line]
    good = [line for line in lines if "malformed" not in line]
    assert len(bad) == 2
    assert all("not MessagePack" in line["malformed"] for line in bad)
    assert all(line["force"] == [1.0, 2.0, 343.0] for line in good)
    ticks = [line["tick"] for line in good]
    assert ticks == sorted(ticks)


def test_chosen_fields_in_words(ask: Ask, endpoints: Endpoints) -> None:
    with talking_robot(endpoints, say):
        done = ask(
            *("echo", "left_ankle_ft", "--count", 3),
            *("--field", "force.2", "--field", "moment"),
        )
    assert "  force.2  343" in done.stdout
    assert "  moment   [0.1, 0.2, 0.3]" in done.stdout
    assert "MALFORMED, 1 bytes: ForceTorque: not MessagePack" in done.stdout


def test_the_rate_is_a_limit(ask: Ask, endpoints: Endpoints) -> None:
    """Between two shown messages others are passed over."""
    with talking_robot(
        endpoints, lambda n, tell: tell("state/ft/left_ankle", force_torque(n))
    ):
        done = ask("echo", "left_ankle_ft", "--count", 4, "--rate", 10, "--json")
    stamps = [json.loads(line)["stamp_ns"] for line in done.stdout.splitlines()]
    ticks = [json.loads(line)["tick"] for line in done.stdout.splitlines()]
    assert ticks[-1] - ticks[0] > len(ticks)
    # By the sender's stamps, so half the distance is safely kept.
    assert stamps[-1] - stamps[0] > 0.5 * 3 * 1e9 / 10


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["left_ankle"], "did you mean 'left_ankle_ft'?"),
        (["state/jonts"], "did you mean 'joints'?"),
        (["xyz"], "channels are joints, imu"),
        (["estop"], "estop is a service of the robot"),
        (["joints", "--field", "dqq.0"], "did you mean 'dq'?"),
        (["joints", "--field", "force"], "fields are schema, tick, stamp_ns, q"),
    ],
)
def test_wrong_names_are_refused_with_the_nearest(
    surefoot_here: Surefoot, words: list[str], expected: str
) -> None:
    done = surefoot_here("echo", *words)
    assert done.returncode == 2
    assert done.stdout == ""
    assert expected in done.stderr


def test_a_part_that_is_not_there_is_refused(ask: Ask, endpoints: Endpoints) -> None:
    with talking_robot(endpoints, say):
        done = ask("echo", "left_ankle_ft", "--field", "force.3", code=2)
    assert "there are 3 entries, 0 to 2" in done.stderr
