"""Robots with one fault each, as processes of their own."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from deploy.driver.acme_driver import AcmeAdapter
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot_side.driver import drive
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import Answer, CommandResult
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import JointCommand
from surefoot.schemas.reasons import ModeCause
from tests.patient_robot import judged_walker

Twist = Callable[[Snapshot, int], Snapshot]
GRAVITY_M_S2 = 9.80665
CHANNELS = ("joints", "imu", "left_ankle_ft", "right_ankle_ft")
STUCK: dict[str, Any] = {}


def wrong_sign(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, ft_left=-s.ft_left, ft_right=-s.ft_right)


def feet_swapped(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, ft_left=s.ft_right, ft_right=s.ft_left)


def joints_swapped(s: Snapshot, tick: int) -> Snapshot:
    """Exchange left and right arm, which are in the same posture."""
    order = np.arange(s.q.size)
    order[8:15], order[21:28] = np.arange(21, 28), np.arange(8, 15)
    return replace(s, q=s.q[order], dq=s.dq[order], effort=s.effort[order])


def degrees(s: Snapshot, tick: int) -> Snapshot:
    """Read degrees but for the first time: a driver refuses to start from those."""
    return replace(s, q=np.degrees(s.q)) if tick > 0 else s


def in_g(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, linear_acceleration=s.linear_acceleration / GRAVITY_M_S2)


def wxyz(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, quat_xyzw=s.quat_xyzw[[3, 0, 1, 2]])


def tick_stands_still(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, tick=0)


def stuck_imu(s: Snapshot, tick: int) -> Snapshot:
    first = STUCK.setdefault("imu", s)
    return replace(
        s,
        quat_xyzw=first.quat_xyzw,
        angular_velocity=first.angular_velocity,
        linear_acceleration=first.linear_acceleration,
    )


def dead_gyroscope(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, angular_velocity=np.zeros(3))


def imu_of_another_clock(s: Snapshot, tick: int) -> Snapshot:
    joints, _, *forces = [s.stamp_ns] * len(CHANNELS)
    return replace(s, measured_ns=(joints, s.stamp_ns - 10**10, *forces))


def stuck_force(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, ft_right=STUCK.setdefault("force", s.ft_right))


def not_finite(s: Snapshot, tick: int) -> Snapshot:
    return replace(s, dq=np.full(s.dq.size, math.nan))


class NoWatchdog(CommandGate):
    """Follows the last posture forever, in ACTIVE."""

    def _watch(self, silence_s: float) -> None:
        pass

    def _watch_delay(self, tick: int) -> None:
        pass  # it would notice a silence, too


class NoLease(CommandGate):
    """Obeys everyone."""

    def request(self, action: str, who: str, *, now_s: float) -> Answer:
        self.modes.lease.holder = who
        return super().request(action, who, now_s=now_s)


class AcceptsNan(CommandGate):
    """Accepts NaN."""

    def _why_no_posture(self, q: list[float]) -> None:
        self._wanted[: len(q)] = q


class AcceptsReplays(CommandGate):
    """Accepts the same command repeatedly."""

    def accept(
        self, command: JointCommand, *, tick: int, now_s: float
    ) -> CommandResult:
        self._sequence = -1
        return super().accept(command, tick=tick, now_s=now_s)


class GivesUsUp(CommandGate):
    """Goes to FAULT as if commands were late, once a motion is commanded."""

    has_given_up = False

    def accept(
        self, command: JointCommand, *, tick: int, now_s: float
    ) -> CommandResult:
        if not self.has_given_up and command.q != self.posture.tolist():
            self.has_given_up = True
            self.modes.fail(ModeCause.SILENCE, "no command for so long")
        return super().accept(command, tick=tick, now_s=now_s)


class IgnoresEstop(CommandGate):
    """Confirms the e-stop and continues."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.modes.stop = lambda source: Answer()  # type: ignore[method-assign]


def broken_robot(
    endpoints: Endpoints,
    twists: tuple[Twist, ...],
    gate: type[CommandGate],
    period_factor: int,
) -> str:
    """Serve such a robot until it is killed."""
    robot = judged_walker()
    inner = AcmeAdapter(robot)

    class Adapter:
        def read(self, tick: int, stamp_ns: int) -> Snapshot:
            if period_factor > 1:
                time.sleep((period_factor - 1) * robot.period_s)
            snapshot = inner.read(tick, stamp_ns)
            for twist in twists:
                snapshot = twist(snapshot, tick)
            return snapshot

        def write(self, q_command: np.ndarray) -> None:
            inner.write(q_command)

    return drive(
        Adapter(), robot, endpoints=endpoints, make_gate=gate, stop=StopRequest()
    )
