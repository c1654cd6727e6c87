"""Requests to a running robot and stabilizer, over loopback TCP."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from msgspec.structs import replace

from surefoot.planner import VelocityPlanner, walk_on_bus
from surefoot.robot_io.client_side.observer import (
    LatestMessages,
    Observer,
)
from surefoot.robot_io.client_side.requests import PlannerClient
from surefoot.robot_io.errors import RequestRefusedError, RobotUnreachableError
from surefoot.robot_io.realtime import Pace, StopRequest
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import EndReason, RequestRefusal, StabilizerState
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.node import run_stabilizer
from surefoot.stabilizer.walking.footsteps import Pace as WalkPace
from surefoot.stabilizer.walking.footsteps import half_width_of
from tests.nodes.processes import (
    Onlooker,
    Running,
    balance,
    balancing,
    looking,
    robot,
    running,
    stabilizer,
)
from tests.nodes.test_nodes import in_one_process
from tests.patient_robot import gentle_settings
from tests.support import PATIENCE_S, wait_until

LONG = {"duration_s": 600.0}
SHORT = {"duration_s": 1.5, "sensors": {"force_noise_n": 2.0}}
LATER_TICKS = 300
NEW_GAIN = 35.0
PUSH_N = [30.0, 0.0, 0.0]


class Run(Onlooker):
    """A robot, its stabilizer and an observer."""

    def __init__(self, plant: Running, control: Running, observer: Observer) -> None:
        super().__init__(observer)
        self.plant, self.control = plant, control

    def has_gone_on(self) -> LatestMessages:
        return self.let_go_on(LATER_TICKS)


@pytest.fixture
def run(request: pytest.FixtureRequest, endpoints: Endpoints) -> Iterator[Run]:
    with (
        running(robot, endpoints, LONG, request.param) as plant,
        running(balance, endpoints, request.param) as control,
        looking(endpoints) as observer,
    ):
        started = Run(plant, control, observer)
        started.until(
            lambda sight: sight.status and sight.status.mode is RobotMode.ACTIVE,
            what="the robot to be commanded",
        )
        yield started


# Requests take the same way at both paces.
@pytest.mark.parametrize("run", [Pace.LOCKSTEP], indirect=True)
def test_gains_change_and_are_recorded_with_their_tick(run: Run) -> None:
    observer = run.observer
    assert observer.requests.change_settings({}).settings["tsid.com_kp"] == [30.0] * 3
    # Of the stabilizer's own ticks: the robot's may be one ahead of what it has read.
    answered = run.until(lambda sight: True, what="any message").stabilizer
    assert answered is not None
    reply = observer.requests.change_settings({"tsid.com_kp": [NEW_GAIN]})
    assert reply.settings["tsid.com_kp"] == [NEW_GAIN] * 3
    assert reply.tick > answered.tick
    with pytest.raises(RequestRefusedError, match="expected 1 or 3") as bad:
        observer.requests.change_settings({"tsid.com_kp": [1.0, 2.0]})
    assert bad.value.refusal is RequestRefusal.BAD_VALUE
    run.has_gone_on()
    observer.requests.stop_robot()
    result = run.control.result()
    (change,) = result.settings_changes
    assert (change.tick, change.source) == (reply.tick, "eve")
    assert change.before == {"tsid.com_kp": [30.0] * 3}
    assert change.after == {"tsid.com_kp": [NEW_GAIN] * 3}
    assert result.end is EndReason.ROBOT_FAULT
    assert "eve" in result.end_detail


@pytest.mark.parametrize("run", [Pace.REALTIME], indirect=True)
def test_a_hold_keeps_the_posture_until_resumed(run: Run) -> None:
    run.has_gone_on()
    run.observer.requests.control("hold")
    held = run.until(
        lambda sight: sight.status and sight.status.mode is RobotMode.HOLD,
        what="the hold",
    )
    later = run.has_gone_on()
    assert held.status is not None
    assert later.status is not None
    assert later.status.q_command == held.status.q_command
    assert later.status.commander == "ann"
    run.until(
        lambda sight: (
            sight.stabilizer and sight.stabilizer.state is StabilizerState.PAUSED
        ),
        what="the stabilizer to say so",
    )
    run.observer.requests.control("resume")
    resumed = run.until(
        lambda sight: (
            sight.status
            and sight.status.mode is RobotMode.ACTIVE
            and sight.stabilizer
            and sight.stabilizer.state is StabilizerState.ACTIVE
        ),
        what="balancing again",
    )
    assert resumed.status is not None
    again = run.has_gone_on()
    assert again.status is not None
    assert again.status.mode is RobotMode.ACTIVE
    assert again.status.refused.get("first_command", 0) == 0


@pytest.mark.parametrize("run", [Pace.LOCKSTEP], indirect=True)
def test_a_push_acts_and_is_recorded(run: Run) -> None:
    before = run.tick()
    run.observer.requests.push("torso", PUSH_N, duration_s=0.2)
    with pytest.raises(RequestRefusedError, match="expected one of torso"):
        run.observer.requests.push("nose", PUSH_N, duration_s=0.2)
    with pytest.raises(RequestRefusedError, match="at most"):
        run.observer.requests.push("torso", [1e6, 0.0, 0.0], duration_s=0.2)
    with pytest.raises(RequestRefusedError, match="duration_s"):
        run.observer.requests.push("torso", PUSH_N, duration_s=-1.0)
    moving = run.until(
        lambda sight: sight.truth and abs(sight.truth.com_velocity[0]) > 0.005,
        what="the body to move",
    )
    run.plant.signal(2)
    (push,) = run.plant.result().pushes
    assert (push.source, push.body, push.force_n) == ("eve", "torso", PUSH_N)
    assert moving.truth is not None
    assert before < push.tick <= moving.truth.tick


def test_who_looks_on_changes_nothing(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, SHORT, Pace.LOCKSTEP) as plant,
        running(balancing, endpoints),
    ):
        with looking(endpoints) as observer:
            wait_until(lambda: observer.latest_messages().truth, what="the truth")
        assert plant.result().log_sha256 == in_one_process(SHORT, "whole-body")


def test_a_controller_without_gains_says_so(endpoints: Endpoints) -> None:
    with (
        running(robot, endpoints, LONG, Pace.REALTIME),
        running(stabilizer, endpoints, Pace.REALTIME),
        looking(endpoints) as observer,
    ):
        wait_until(lambda: observer.latest_messages().stabilizer, what="the stabilizer")
        assert observer.requests.change_settings({}).settings == {}
        with pytest.raises(RequestRefusedError, match="takes no settings") as caught:
            observer.requests.change_settings({"tsid.com_kp": [NEW_GAIN]})
        assert caught.value.refusal is RequestRefusal.NOT_SUPPORTED


def hesitant(endpoints: Endpoints) -> Any:
    """Run a whole-body stabilizer whose first shift takes long."""
    walker = load_robot("walker")
    settings = gentle_settings()
    slow = replace(settings, walk=replace(settings.walk, shift_s=60.0))
    return run_stabilizer(
        lambda settings: make_controller("whole-body", walker, settings),
        walker,
        endpoints=endpoints,
        pace=Pace.LOCKSTEP,
        identity="ann",
        connect_timeout_s=PATIENCE_S,
        settings=slow,
    )


def test_a_walk_that_a_hold_has_ended_is_told_to_stand(endpoints: Endpoints) -> None:
    walker = load_robot("walker")
    planner = VelocityPlanner(
        WalkPace(0.1, 0.0, 0.0, 0.6, 0.2, 0.05), half_width=half_width_of(walker)
    )
    with (
        running(robot, endpoints, LONG, Pace.LOCKSTEP) as plant,
        running(hesitant, endpoints) as control,
        looking(endpoints) as observer,
        PlannerClient(walker, endpoints=endpoints) as client,
    ):
        client.connect(timeout_s=PATIENCE_S)
        run = Run(plant, control, observer)
        run.has_gone_on()
        client.send(planner.plan(None))
        run.until(lambda s: s.walk_status and s.walk_status.phase == "shift", what="it")
        for action in ("hold", "resume"):
            observer.requests.control(action)
            seen = run.until(
                lambda s: s.walk_status and s.walk_status.phase == "stand", what="it"
            )
            assert seen.walk_status is not None
            assert seen.walk_status.last_step == -1
            later = run.has_gone_on().walk_status
            assert later is not None
            assert later.phase == "stand"
            assert later.tick > seen.walk_status.tick
        observer.requests.stop_robot()
        with pytest.raises(RobotUnreachableError, match="the robot is in fault"):
            walk_on_bus(client, planner, steps=2, stop=StopRequest())
