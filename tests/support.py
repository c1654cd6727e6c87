"""Helpers of all tests: waiting instead of sleeping, files of runs, a scenario."""

from __future__ import annotations

import os
import random
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import msgspec

import surefoot as sf
from surefoot.robot_io.robot import Robot

_T = TypeVar("_T")
PATIENCE_S = 300.0 * float(os.environ.get("SUREFOOT_TEST_PATIENCE", "1"))
"""Longest wait for anything that must happen [s].

It is the only time limit of all tests. It only ends broken runs, so it is far longer
than a slow and busy machine needs; nothing is measured by it.
"""
TEST_PORTS = (18000, 32000)
"""Range of ports to listen at, below those for outgoing connections."""
_PAUSE_S = 0.01
"""Pause between checks [s]; shorter ones would slow what is waited for."""


def wait_until(
    condition: Callable[[], _T], *, what: str, patience_s: float = PATIENCE_S
) -> _T:
    """Evaluate a condition repeatedly until it is true.

    Returns:
        The condition's value.

    Raises:
        AssertionError: it was not true in time.
    """
    end = time.monotonic() + patience_s
    while not (answer := condition()):
        assert time.monotonic() < end, f"waited {patience_s} s for {what}"
        time.sleep(_PAUSE_S)
    return answer


def free_port() -> int:
    """Return a TCP port at 127.0.0.1 on which nobody listens.

    It is none of those that the system gives to outgoing connections: until the test
    listens there, one of another test might take it.
    """
    while True:
        port = random.SystemRandom().randrange(*TEST_PORTS)
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def is_gone(process: int) -> bool:
    """Return whether the process of an id has ended."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    return False


def ticks_on_disk(out: Path) -> int:
    """Return how many ticks of a run under way can be read from its folder."""
    try:
        return sf.read_signals(out).count
    except sf.UsageError:
        return 0


ROLLING = sf.Scenario(
    name="short roll",
    duration_s=0.5,
    platform=[
        sf.Platform(
            foot="both",
            motion=[sf.SineMotion(axis="roll", amplitude_deg=3.0, frequency_hz=2.0)],
        )
    ],
    sensors=sf.Sensors(force_noise_n=2.0, gyro_noise_rad_s=0.002),
)
"""Half a second in which every signal moves, with noise from the seed."""


def with_rate(robot: Robot, rate_hz: float) -> Robot:
    """Return the same robot at another control rate."""
    return replace(robot, file=msgspec.structs.replace(robot.file, rate_hz=rate_hz))


def with_late_commands(robot: Robot) -> Robot:
    """Return a robot whose gate accepts commands however late they come."""
    gate = msgspec.structs.replace(
        robot.file.gate, max_loop_delay_s=None, max_command_age_s=None
    )
    return replace(robot, file=msgspec.structs.replace(robot.file, gate=gate))


def with_knees(robot: Robot, share: float) -> Robot:
    """Return a robot whose knees have only this share of their torque."""
    joints = [
        msgspec.structs.replace(joint, torque_limit_nm=share * joint.torque_limit_nm)
        if joint.name.endswith("_knee")
        else joint
        for joint in robot.file.joint
    ]
    return replace(robot, file=msgspec.structs.replace(robot.file, joint=joints))


def with_speeds(robot: Robot, speed_rad_s: float, *, only: str = "") -> Robot:
    """Return a robot whose joints are slower or faster, or those of some names only."""
    joints = [
        msgspec.structs.replace(joint, velocity_limit_rad_s=speed_rad_s)
        if only in joint.name
        else joint
        for joint in robot.file.joint
    ]
    return replace(robot, file=msgspec.structs.replace(robot.file, joint=joints))
