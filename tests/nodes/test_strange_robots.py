"""The stabilizer with other robots than the Walker, and its messages on them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.stabilizer.model import RobotModel
from tests.nodes.processes import running, stabilizer
from tests.robot_io.served_robot import serving
from tests.stabilizer.standing_snapshot import standing_snapshot
from tests.support import wait_until

WALKER = load_robot("walker")
SINCE_1970_NS = 1_800_000_000_000_000_000
LATER_S = 1e6


@pytest.mark.parametrize("begin_ns", [SINCE_1970_NS, 0], ids=["ahead", "behind"])
def test_a_lost_lease_is_noticed_whatever_clock_stamps_the_sensors(
    endpoints: Endpoints, begin_ns: int
) -> None:
    standing = standing_snapshot(RobotModel(WALKER))

    def go_on(server: RobotServer, gate: CommandGate) -> RobotMode:
        tick = robot.tick
        robot.tick += 1
        gate.begin_tick(now_s=tick * WALKER.period_s)
        stamp_ns = begin_ns + tick
        sensed = replace(standing, tick=tick, stamp_ns=stamp_ns)
        server.publish_sensors(sensed, stamp_ns=stamp_ns)
        return gate.mode

    def is_answered(server: RobotServer, gate: CommandGate) -> bool:
        go_on(server, gate)
        status = gate.status(tick=0, stamp_ns=0, now_s=LATER_S, deadline_misses=0)
        return status.command_age_s >= 0.0

    with (
        serving(WALKER, endpoints) as robot,
        running(stabilizer, endpoints, Pace.REALTIME) as commander,
    ):
        wait_until(lambda: robot.do(is_answered), what="commands")
        robot.do(lambda _, gate: gate.modes.lose(ModeCause.LEASE_EXPIRED, "test"))

        def has_left() -> bool:
            robot.do(go_on)
            return commander.process.exitcode is not None

        wait_until(has_left, what="the stabilizer to leave")
        assert commander.result().end is EndReason.LEASE_LOST


def test_a_run_in_which_no_sensor_was_heard_is_no_good_end(
    endpoints: Endpoints,
) -> None:
    with (
        serving(WALKER, endpoints) as robot,
        running(stabilizer, endpoints, Pace.REALTIME) as commander,
    ):

        def is_enabled(_: RobotServer, gate: CommandGate) -> bool:
            return gate.mode is RobotMode.ACTIVE

        wait_until(lambda: robot.do(is_enabled), what="a commander")
        robot.do(lambda _, gate: gate.modes.finish(ModeCause.RUN_OVER, "2 s"))
        told = commander.result()
    assert told.end is EndReason.ROBOT_SILENT
    assert told.end_detail == (
        "no news from joints, imu, left_ankle_ft, right_ankle_ft until its run was over"
    )
