"""Listeners report when the robot was out of reach, and do not exit with success."""

from __future__ import annotations

import json
import subprocess
import threading
import time
from pathlib import Path

import pytest

from surefoot.robot_io.robot import load_robot
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SCHEMA_VERSION, RobotMode, RobotStatus
from surefoot.schemas.reasons import ModeCause
from tests.cli.bus.talking_robot import Say, force_torque, talking_robot
from tests.command import command, environment
from tests.files.cut_link import Cable
from tests.support import PATIENCE_S, wait_until

WALKER = load_robot("walker")
AWAY_S = 0.7


class Robot:
    """Publishes an ankle's force every tick and a status, at the end with mode OFF."""

    def __init__(self) -> None:
        self.tick = 0
        self.ends = threading.Event()

    def say(self, count: int, tell: Say) -> None:
        self.tick = count
        tell("state/ft/left_ankle", force_torque(count))
        tell("state/status", self._status(count))

    def _status(self, tick: int) -> bytes:
        is_over = self.ends.is_set()
        return encode(
            RobotStatus(
                schema=SCHEMA_VERSION,
                tick=tick,
                stamp_ns=time.monotonic_ns(),
                mode=RobotMode.OFF if is_over else RobotMode.ACTIVE,
                cause=ModeCause.RUN_OVER if is_over else ModeCause.REQUESTED,
                detail="",
                notice="",
                commander="" if is_over else "ann",
                command_age_s=0.0,
                q_command=WALKER.nominal.tolist(),
                refused={},
                clipped={},
                deadline_misses=0,
            )
        )

    def end(self) -> None:
        """Publish the last status long enough to be heard."""
        self.ends.set()
        last = self.tick + 20
        wait_until(lambda: self.tick > last, what="the last status")


def interrupted(cable: Cable) -> None:
    """Unplug the cable for a while."""
    cable.pull()
    end = time.monotonic() + AWAY_S
    wait_until(lambda: time.monotonic() > end, what="time to pass")
    cable.plug_in()


def start(words: tuple[object, ...], log: Path) -> subprocess.Popen[str]:
    with log.open("w") as stderr:
        return subprocess.Popen(
            command(*words),
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
        )


def test_a_record_with_a_hole_says_so_and_is_no_success(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    out, log = tmp_path / "hole.mcap", tmp_path / "log"
    robot = Robot()
    with Cable(endpoints.connect[0]) as cable:
        with talking_robot(endpoints, robot.say):
            words = ("record", "--out", out, "--json", "--connect", cable.locator)
            recorder = start((*words, "--wait", 60), log)
            wait_until(lambda: "ready" in log.read_text(), what="recorder")
            interrupted(cable)
            cut_at = robot.tick
            # It is heard again: what it says from now on is in the record.
            size = out.with_name("hole.mcap.partial").stat().st_size
            wait_until(lambda: robot.tick > cut_at + 500, what="ticks")
            wait_until(
                lambda: out.with_name("hole.mcap.partial").stat().st_size > size,
                what="the record to grow",
            )
            robot.end()
        stdout, _ = recorder.communicate(timeout=PATIENCE_S)
    told = log.read_text()
    assert recorder.returncode == 1, told
    assert "the link to the robot was lost for" in told
    left = next(c for c in json.loads(stdout) if c["channel"] == "left_ankle_ft")
    assert left["missing"] > 100
    assert left["last"] > cut_at
    assert out.exists()


def test_a_robot_that_ends_in_order_is_a_success(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    out, log = tmp_path / "whole.mcap", tmp_path / "log"
    robot = Robot()
    with talking_robot(endpoints, robot.say):
        words = ("record", "--out", out, "--connect", endpoints.connect[0])
        recorder = start((*words, "--wait", 60), log)
        wait_until(lambda: "ready" in log.read_text(), what="recorder")
        robot.end()
    begin = time.monotonic()
    recorder.communicate(timeout=PATIENCE_S)
    assert recorder.returncode == 0, log.read_text()
    assert time.monotonic() - begin < 5.0  # it did not wait for a return
    assert "lost" not in log.read_text()


def heard_by(
    cable: Cable, robot: Robot, words: tuple[object, ...], log: Path
) -> subprocess.Popen[str]:
    """Start a bus tool behind the cable, and wait until it has heard the robot."""
    tool = start((*words, "--connect", cable.locator, "--wait", 60), log)
    wait_until(lambda: len(cable._ends) > 0, what="the tool to dial")
    begin = robot.tick
    wait_until(lambda: robot.tick > begin + 700, what="the tool to hear")
    return tool


@pytest.mark.usual("hz")
@pytest.mark.parametrize(
    "words",
    [
        ("hz", "left_ankle_ft", "--for", 6, "--json"),
        ("topics", "--for", 6, "--json"),
        ("echo", "left_ankle_ft", "--count", 2000, "--json"),
    ],
    ids=lambda words: words[0],
)
def test_tools_of_the_bus_say_that_the_link_was_lost(
    words: tuple[object, ...], endpoints: Endpoints, tmp_path: Path
) -> None:
    robot = Robot()
    log = tmp_path / "log"
    with Cable(endpoints.connect[0]) as cable, talking_robot(endpoints, robot.say):
        tool = heard_by(cable, robot, words, log)
        interrupted(cable)
        tool.communicate(timeout=PATIENCE_S)
    told = log.read_text()
    assert tool.returncode == 1, told
    assert "the link to the robot was lost for" in told
    assert "Traceback" not in told


@pytest.mark.parametrize(
    "words",
    [("hz", "left_ankle_ft", "--for", 600), ("echo", "left_ankle_ft")],
    ids=lambda words: words[0],
)
def test_tools_of_the_bus_end_well_with_a_robot_that_does(
    words: tuple[object, ...], endpoints: Endpoints, tmp_path: Path
) -> None:
    robot = Robot()
    log = tmp_path / "log"
    with Cable(endpoints.connect[0]) as cable:
        with talking_robot(endpoints, robot.say):
            tool = heard_by(cable, robot, words, log)
            robot.end()
        tool.communicate(timeout=PATIENCE_S)
    assert tool.returncode == 0, log.read_text()
    assert "lost" not in log.read_text()
