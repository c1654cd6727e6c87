"""Measures the offsets of a live robot's ankle sensors, and stores them."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from surefoot.errors import UsageError
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout
from surefoot.robot_io.tare import Tare, load_tare, save_tare
from surefoot.schemas.arrays import Array
from surefoot.schemas.endpoints import Endpoints
from surefoot.stabilizer.estimation.wrench_compensation import foot_offsets
from surefoot.stabilizer.model import RobotModel

FootChoice = Literal["left", "right", "both"]
CHANNELS = ("joints", "imu", "left_ankle_ft", "right_ankle_ft")
LARGEST_OFFSET_N = 100.0
"""A foot that feels more stands on something, or its sensor is broken [N]."""
LARGEST_SCATTER_N = 20.0
"""Standard deviation of a foot that is moved [N]."""
FEWEST_READINGS = 20


class TareFound(NamedTuple):
    """What was measured and stored.

    Attributes:
        path: where.
        found: (2, 6) what was found beside what was known, left and right [N, N m].
        tare: all of it, as stored.
        readings: of how many readings it is the mean.
    """

    path: Path
    found: Array
    tare: Tare
    readings: int


def measure_tare(
    robot: Robot,
    *,
    endpoints: Endpoints,
    foot: FootChoice = "both",
    duration_s: float = 2.0,
    timeout_s: float = 10.0,
) -> TareFound:
    """Measure a robot at rest whose foot, or feet, touch nothing, and store it.

    Nothing is commanded. The driver takes the offsets off from its next start on.

    Args:
        robot: what its files say; the offsets go beside its TOML.
        endpoints: where to find it.
        foot: which of its feet hang free.
        duration_s: how long to average [s].
        timeout_s: how long to look for the robot [s].

    Raises:
        RobotIoError: there is no robot.
        UsageError: a foot stands or moves, or too few readings came.
        OSError: the file cannot be written.
    """
    readings: dict[str, list[Array]] = {}
    with Observer(robot, endpoints=endpoints, channels=CHANNELS, depth=64) as observer:
        observer.connect(timeout_s=timeout_s)
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s and not observer.has_left():
            for sample in observer.take(timeout_s=0.1):
                for name, values in _numbers(observer.decode(sample), sample.channel):
                    readings.setdefault(name, []).append(values)
    fewest = min((len(readings.get(name, [])) for name in _FIELDS), default=0)
    if fewest < FEWEST_READINGS:
        raise UsageError(
            f"tare: got {fewest} readings of every sensor in {duration_s:g} s, "
            f"expected {FEWEST_READINGS} or more; measure for longer"
        )
    found = foot_offsets(RobotModel(robot), _mean(robot, readings))
    for side, name in enumerate(("left", "right")):
        if foot not in (name, "both"):
            found[side] = 0.0
            continue
        force = float(np.linalg.norm(found[side, :3]))
        scatter = float(np.std(readings[f"ft_{name}"], axis=0)[:3].max())
        if force > LARGEST_OFFSET_N or scatter > LARGEST_SCATTER_N:
            raise UsageError(
                f"tare: the {name} foot feels {force:.0f} N, changing by {scatter:.0f} "
                f"N, expected at most {LARGEST_OFFSET_N:g} N and {LARGEST_SCATTER_N:g} "
                "N of a foot that touches nothing and is at rest; lift the robot, or "
                "one foot and name it with --foot"
            )
    tare = load_tare(robot.path).plus(found[0], found[1])
    return TareFound(save_tare(robot.path, tare), found, tare, fewest)


_FIELDS = ("q", "linear_acceleration", "ft_left", "ft_right")


def _numbers(message: Any, channel: str) -> list[tuple[str, Array]]:
    """Return the fields of a snapshot that a message fills."""
    if channel == "joints":
        return [("q", np.array(message.q))]
    if channel == "imu":
        return [("linear_acceleration", np.array(message.linear_acceleration))]
    name = "ft_left" if channel == "left_ankle_ft" else "ft_right"
    return [(name, np.array([*message.force, *message.moment]))]


def _mean(robot: Robot, readings: dict[str, list[Array]]) -> Snapshot:
    layout = SnapshotLayout(robot.n_a)
    empty = layout.view(0, 0, np.zeros(layout.size))
    means: dict[str, Any] = {name: np.mean(readings[name], axis=0) for name in _FIELDS}
    return replace(empty, **means)
