from __future__ import annotations

import json

import pytest

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.topics import TOPICS
from tests.cli.bus.conftest import Ask
from tests.cli.bus.talking_robot import Say, force_torque, talking_robot

KEY = "state/ft/left_ankle"


def say(count: int, tell: Say) -> None:
    tell(KEY, force_torque(count))
    tell("state/ft/left_ancle", b"??")
    if count % 2:
        tell("ref", b"\x81\xa1x\x01")


def test_channels_and_unknown_keys_are_told_apart(
    ask: Ask, endpoints: Endpoints
) -> None:
    with (
        talking_robot(endpoints, say),
        Bus(endpoints, Role.CLIENT, namespace="runner") as stranger,
    ):
        # Kept: a publisher that nobody holds is withdrawn at once.
        publisher = stranger.publisher("cmd/joints", urgent=False)
        assert publisher is not None
        ring = stranger.channel("state/joints", depth=1)
        assert ring is not None
        done = ask("topics", "--json")
    told = json.loads(done.stdout)
    channels = {row["channel"]: row for row in told["channels"]}
    assert list(channels) == [entry.name for entry in TOPICS]
    force = channels["left_ankle_ft"]
    assert force["key"] == f"walker/{KEY}"
    assert force["type"] == "ForceTorque"
    assert force["messages"] > 0
    assert force["rate_hz"] * told["listened_s"] == pytest.approx(force["messages"])
    # The larger the tick, the longer the message.
    assert len(force_torque(0)) <= force["bytes"] <= len(force_torque(10**6))
    assert force["malformed"] == 0
    assert channels["joints"]["messages"] == 0
    reference = channels["reference"]
    assert reference["malformed"] == reference["messages"] > 0
    assert "unknown field" in reference["malformed_reason"]
    assert "reference" in done.stderr
    unknown = {row["key"]: row for row in told["unknown"]}
    assert unknown["walker/state/ft/left_ancle"]["bytes"] == 2
    # Silent, and of another robot: only the graph knows of it.
    (publisher_name,) = unknown["runner/cmd/joints"]["publishers"]
    assert publisher_name.startswith("client ")
    assert unknown["runner/state/joints"]["subscribers"] == [publisher_name]


def test_the_table_names_robot_and_stabilizer(ask: Ask, endpoints: Endpoints) -> None:
    """Who they are comes from their liveliness tokens."""
    with (
        talking_robot(endpoints, say),
        Bus(endpoints, Role.CLIENT, namespace="walker") as stabilizer,
    ):
        publisher = stabilizer.publisher("cmd/joints", urgent=True)
        assert publisher is not None
        stabilizer.announce("alive/stabilizer/ann")
        done = ask("topics", "--for", 0.3)
    (command,) = (
        line.split() for line in done.stdout.splitlines() if "joint_command" in line
    )
    assert command[:4] == ["joint_command", "cmd/joints", "JointCommand", "stabilizer"]
    assert "on the bus: robot, stabilizer ann" in done.stdout
    assert "state/ft/left_ancle" in done.stdout
