"""Every command that meets another robot than the named one refuses it by name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.errors import ExitCode
from surefoot.schemas.endpoints import Endpoints
from tests.command import Surefoot
from tests.robot_io.meeting_places import meeting_place
from tests.robot_io.served_robot import ServedRobot, serving
from tests.robot_io.strange_robots import WALKER, mirrored_feet_file
from tests.support import free_port

WAIT = ["--wait", 60]
DIALING = {
    "stabilizer": ["stabilizer", *WAIT],
    "reconnecting": ["stabilizer", "--reconnect", *WAIT],
    "record": ["record", "--out", "a.mcap", *WAIT],
    "topics": ["topics", *WAIT],
    "echo": ["echo", "status", *WAIT],
    "hz": ["hz", *WAIT],
    "check-robot": ["check-robot", *WAIT],
    "relay": ["relay", "clear", *WAIT],
    "view": ["view", "--port", 0],
}


@pytest.fixture(scope="module")
def place() -> Iterator[Endpoints]:
    with meeting_place(routed=False) as endpoints:
        yield endpoints


@pytest.fixture(scope="module")
def served(place: Endpoints) -> Iterator[ServedRobot]:
    with serving(WALKER, place) as robot:
        yield robot


@pytest.mark.parametrize("name", DIALING)
def test_who_dials_with_another_description_is_refused(
    surefoot_here: Surefoot,
    tmp_path: Path,
    served: ServedRobot,
    place: Endpoints,
    name: str,
) -> None:
    if name == "view":
        pytest.importorskip("viser")
    words = [*DIALING[name], "--connect", place.connect[0]]
    if name == "relay":
        words += ["--listen", f"tcp/127.0.0.1:{free_port()}"]
    ours = {
        "feet": ("--robot", mirrored_feet_file(tmp_path)),
        "servo": ("--servo-profile", "harmonic"),
    }
    for differing, option in ours.items():
        done = surefoot_here(*words, *option)
        assert done.returncode == ExitCode.USAGE, done.stderr
        assert "robot 'walker'" in done.stderr
        assert f"differs in: {differing};" in done.stderr
        assert "give both sides the same robot file" in done.stderr
        assert "Traceback" not in done.stderr
    assert served.do(lambda server, gate: gate.modes.lease.holder) == ""


def test_a_second_robot_does_not_start(
    surefoot: Surefoot, short_scenario: Path, routed: Endpoints
) -> None:
    with serving(WALKER, routed) as first:
        done = surefoot("robot", short_scenario, "--router", routed.router[0])
        assert done.returncode == ExitCode.USAGE, done.stderr
        assert f"instance {first.server.identity.instance}" in done.stderr
        assert "`namespace` of its own" in done.stderr
        assert "Traceback" not in done.stderr
