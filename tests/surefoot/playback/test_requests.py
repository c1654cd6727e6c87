"""Records of runs with requests (settings, holds, walks) are computed again."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from surefoot.planner import VelocityPlanner
from surefoot.robot_io.client_side.observer import LatestMessages
from surefoot.robot_io.client_side.requests import PlannerClient
from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.robot_loop import run_robot
from surefoot.stabilizer.walking.footsteps import Pace as WalkPace
from surefoot.stabilizer.walking.footsteps import half_width_of
from tests.command import command, environment
from tests.nodes.processes import Onlooker, balance, looking, running
from tests.patient_robot import GENTLE, patient_robot_file
from tests.support import PATIENCE_S, wait_until
from tests.surefoot.playback.conftest import Check
from tests.surefoot.recording.mcap_reading import messages

LONG = {"duration_s": 600.0, "sensors": {"force_noise_n": 2.0}}
LATER_TICKS = 150
WAITS = {"hold_after_s": 30.0, "lease_s": 60.0}
"""Long silences are allowed; a busy machine must not end the run."""
AS_RECORDED = [word for value in GENTLE for word in ("--set", value)]
"""The settings as options, since this recorder does not attach them."""


def plant(path: str, endpoints: Endpoints, pace: Pace) -> Any:
    scenario = scenario_from_table({"name": "test", **LONG}, source="test")
    return run_robot(
        load_robot(path),
        scenario,
        seed=1,
        endpoints=endpoints,
        pace=pace,
        wait_s=PATIENCE_S,
    )


class Commanded(Onlooker):
    """A robot under command."""

    def mode(self, mode: RobotMode, commander: str) -> None:
        self.until(
            lambda sight: (
                sight.status
                and sight.status.mode is mode
                and sight.status.commander == commander
            ),
            what=f"{mode} by {commander}",
        )


@contextmanager
def recorded(path: str, endpoints: Endpoints, out: Path) -> Iterator[Commanded]:
    """Record and observe a robot, which must end inside the context."""
    log = out.with_suffix(".log")
    with log.open("w") as stderr:
        recorder = subprocess.Popen(
            command(
                *("record", "--out", out, "--robot", path),
                *("--connect", endpoints.connect[0], "--json"),
            ),
            env=environment(),
            stdout=subprocess.DEVNULL,
            stderr=stderr,
        )
    try:
        wait_until(lambda: "ready" in log.read_text(), what="the recorder")
        with looking(endpoints, path) as observer:
            yield Commanded(observer)
        assert recorder.wait(PATIENCE_S) == 0, log.read_text()
    finally:
        recorder.kill()
        recorder.wait()


@pytest.mark.usual("lockstep")
@pytest.mark.parametrize("pace", list(Pace), ids=str)
def test_gains_holds_pushes_and_a_stop_are_equal(
    endpoints: Endpoints, tmp_path: Path, check: Check, pace: Pace
) -> None:
    path, out = str(patient_robot_file(tmp_path, **WAITS)), tmp_path / "asked.mcap"
    with (
        running(plant, path, endpoints, pace) as robot,
        recorded(path, endpoints, out) as onlooker,
        running(balance, endpoints, pace, "ann", path) as stabilizer,
    ):
        ask = onlooker.observer.requests
        onlooker.mode(RobotMode.ACTIVE, "ann")
        onlooker.let_go_on(LATER_TICKS)
        ask.change_settings({"tsid.com_kp": [35.0]})
        ask.push("torso", [25.0, 0.0, 0.0], duration_s=0.1)
        # The ramp is on its way when the hold begins, and goes on after it.
        ask.control("hold")
        onlooker.mode(RobotMode.HOLD, "ann")
        ask.change_settings({"dik.com_gain": [2.5], "tsid.base_kd": [22.0]})
        onlooker.let_go_on(LATER_TICKS)
        ask.control("resume")
        onlooker.mode(RobotMode.ACTIVE, "ann")
        for _ in range(5):
            onlooker.let_go_on(LATER_TICKS)
        stabilizer.signal(signal.SIGINT)
        stabilizer.result()
        onlooker.mode(RobotMode.HOLD, "")
        robot.signal(signal.SIGINT)
        robot.result()
    code, found = check(out, *AS_RECORDED)
    assert code == 0, found
    (session,) = found["sessions"]
    told: dict[str, list[dict[str, Any]]] = {}
    for message in messages(out):
        told.setdefault(message.channel, []).append(message.content)
    assert session["compared"] == len(told["joint_command"])
    changes = [change["tick"] for change in told["settings_change"]]
    stops = [s["tick"] for s in told["stabilizer"] if s["state"] == "soft_stop"]
    assert len(changes) == 2
    # Without the hold's restart, or the gains, the commands would be others.
    assert session["last_tick"] > stops[0] > changes[-1] + LATER_TICKS


def test_walks_are_equal_whoever_planned_their_steps(
    endpoints: Endpoints, tmp_path: Path, check: Check
) -> None:
    """Ann has steps of her own; Bob, after her, only those a planner gives him."""
    path, out = str(patient_robot_file(tmp_path, **WAITS)), tmp_path / "walks.mcap"
    planner = VelocityPlanner(
        WalkPace(0.1, 0.0, 0.0, 0.4, 0.1, 0.05),
        half_width=half_width_of(load_robot(path)),
    )
    own = replace(planner.plan(None), begin_tick=2 * LATER_TICKS)
    with (
        running(plant, path, endpoints, Pace.LOCKSTEP) as robot,
        recorded(path, endpoints, out) as onlooker,
        PlannerClient(load_robot(path), endpoints=endpoints) as client,
    ):
        client.connect(timeout_s=PATIENCE_S)
        with running(balance, endpoints, Pace.LOCKSTEP, "ann", path, own) as first:
            onlooker.until(is_in("single"), what="Ann's first step")
            first.kill()
        onlooker.mode(RobotMode.HOLD, "")
        with running(balance, endpoints, Pace.LOCKSTEP, "bob", path):
            onlooker.mode(RobotMode.ACTIVE, "bob")
            onlooker.let_go_on(3 * LATER_TICKS)
            client.send(planner.plan(None))
            onlooker.until(is_in("shift"), what="Bob's shift")
            onlooker.let_go_on(LATER_TICKS)
            robot.signal(signal.SIGINT)
            robot.result()
    code, found = check(out, *AS_RECORDED)
    assert code == 0, found
    assert [session["commander"] for session in found["sessions"]] == ["ann", "bob"]
    taken = [m.content["tick"] for m in messages(out) if m.channel == "walk_taken"]
    assert [
        session["first_tick"] <= tick <= session["last_tick"]
        for session, tick in zip(found["sessions"], taken, strict=True)
    ] == [True, True]
    assert not any("in real time" in note for note in found["notes"])
    code, other = check(out, *AS_RECORDED, "--set", "tsid.com_kp=31")
    assert code == 1
    assert any("in real time" in note for note in other["notes"])


def is_in(phase: str) -> Callable[[LatestMessages], object]:
    """Return whether a robot's walk is in a phase."""
    return lambda sight: sight.walk_status and sight.walk_status.phase == phase
