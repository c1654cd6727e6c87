"""What tests share: patience instead of sleeps, what a run leaves, a short scenario."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import msgspec

import surefoot as sf
from surefoot.robot_io.robot import Robot

_T = TypeVar("_T")
PATIENCE_S = 300.0 * float(os.environ.get("SUREFOOT_TEST_PATIENCE", "1"))
"""How long anything that must happen is waited for: the one bound in seconds of all
tests. It only ends what is broken, so it is far beyond what a slow machine beside other
work needs: nothing is measured by it."""
_PAUSE_S = 0.01
"""Asked more often, what only waits would take the processor from what it waits for."""


def wait_until(
    condition: Callable[[], _T], *, what: str, patience_s: float = PATIENCE_S
) -> _T:
    """Ask again and again until the answer is truthy.

    Returns:
        That answer.

    Raises:
        AssertionError: patience ended first.
    """
    end = time.monotonic() + patience_s
    while not (answer := condition()):
        assert time.monotonic() < end, f"waited {patience_s} s for {what}"
        time.sleep(_PAUSE_S)
    return answer


def free_port() -> int:
    """A TCP port nobody listens on at 127.0.0.1."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def is_gone(process: int) -> bool:
    """Whether a process of that id has ended."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    return False


def ticks_on_disk(out: Path) -> int:
    """How many ticks of a run that goes on can be read from its folder."""
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
"""Half a second in which every signal moves, with noise that depends on the seed."""


def with_rate(robot: Robot, rate_hz: float) -> Robot:
    """The same robot at another control rate."""
    return replace(robot, file=msgspec.structs.replace(robot.file, rate_hz=rate_hz))
