"""Tells how much of a scenario a robot can reach, and scales it to the robot."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from surefoot.errors import UsageError
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.scenario import Platform, Push, Scenario
from surefoot.schemas.settings import WalkSettings
from surefoot.sim_robot.motion import motion_law
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.legs import one_foot_share
from surefoot.stabilizer.stance.nominal import capture_limits, reach_search
from surefoot.stabilizer.stance.solver import Ground, GroundPose, ReachSearch
from surefoot.stabilizer.walking.footsteps import (
    SIDES,
    Foothold,
    half_width_of,
    mean_yaw,
    plan_of,
)

SAMPLE_S = 0.01
KEPT_SHARE = 0.9
"""Part of the reachable motion that a scenario is scaled to [1]."""
LEAST_SHARE = 0.05
PUSH_SHARE = 0.6
"""Part of the capture limit that pushes are scaled to [1]."""
FLAT_SHARE = 0.9
"""Part of a step that both soles must reach flat; one that tilts a little reaches
farther [1]."""
FOLLOWED_HZ = 0.2
"""Ground that heaves more slowly takes the centre of mass along [Hz]."""
_AXES = ("z", "roll", "pitch")
_SIZES = (
    *("amplitude_m", "amplitude_deg", "peak_to_peak_m", "peak_to_peak_deg"),
    *("gain", "scale"),
)
"""Keys that scale a motion, for all kinds of motion."""
_PACES = ("velocity_m_s", "lateral_m_s", "yaw_rate_deg_s")
"""Keys that shorten the steps of a walk."""


class ScenarioFit(msgspec.Struct, frozen=True, kw_only=True):
    """A scenario compared with a robot's reach.

    Attributes:
        name: name of the scenario.
        ground_share: part of the ground's motion that the joints reach, at most 1.
        push_share: hardest push over what the soles can catch; 0 without pushes.
        step_share: part of a walk's steps that both soles reach, at most 1.
        why: what is out of reach, in words; empty when nothing is.
    """

    name: str
    ground_share: float
    push_share: float
    step_share: float
    why: str


def fit(
    scenario: Scenario,
    robot: Robot,
    *,
    search: ReachSearch | None = None,
    capture: Array | None = None,
) -> ScenarioFit:
    """Compare a scenario with what a robot reaches in its nominal stance.

    Args:
        scenario: its ground and pushes.
        robot: the robot that is to stand it.
        search: the robot's reach, to be reused for many scenarios.
        capture: (8,) the robot's capture limits [N s]; computed when None.
    """
    model = RobotModel(robot)
    search = search or reach_search(model)
    share = search.largest_share(_extremes(scenario))
    capture = capture_limits(model) if capture is None else capture
    pushed = _push_share(scenario, capture)
    words = []
    if share < 1.0:
        words.append(f"the legs reach {100.0 * share:.0f} % of the ground's motion")
    if pushed > 1.0:
        words.append(f"a push is {pushed:.1f} times what the soles can catch")
    steps = 1.0
    if scenario.walk is not None:
        if (needed := one_foot_share(model)) > 1.0:
            words.append(f"one knee alone needs {100.0 * needed:.0f} % of its torque")
        steps = search.step_share(_steps(scenario, robot))
        if steps < FLAT_SHARE:
            words.append(f"both soles reach {100.0 * steps:.0f} % of the steps")
    return ScenarioFit(
        name=scenario.name,
        ground_share=share,
        push_share=pushed,
        step_share=steps,
        why="; ".join(words),
    )


def scale_to_robot(scenario: Scenario, robot: Robot) -> tuple[Scenario, str]:
    """Scale a scenario down where a robot cannot reach it.

    All motions of the ground are scaled by one factor, also those along x and y. Rates
    and frequencies stay. Pushes beyond the capture limit have a factor of their own; so
    has the velocity of a walk whose steps are too long.

    Returns:
        The scenario, and in words what was done; unchanged and no words if it fits.

    Raises:
        UsageError: hardly any of it can be reached.
    """
    found = fit(scenario, robot)
    if not found.why:
        return scenario, ""
    walk = scenario.walk
    paces = {} if walk is None else {name: getattr(walk, name) for name in _PACES}
    shortens = found.step_share < FLAT_SHARE and any(paces.values())
    if found.ground_share == 1.0 and found.push_share <= 1.0 and not shortens:
        raise UsageError(
            f"{scenario.name}: {robot.file.name} cannot walk: {found.why}; see "
            "surefoot check-robot-file"
        )
    if found.ground_share < LEAST_SHARE:
        raise UsageError(
            f"{scenario.name}: {robot.file.name} reaches "
            f"{100.0 * found.ground_share:.0f} % of the ground's motion, too little to "
            "scale to; see surefoot check-robot-file"
        )
    words: list[str] = []
    changes: dict[str, Any] = {}
    if found.ground_share < 1.0:
        share = round(KEPT_SHARE * found.ground_share, 2)
        changes["platform"] = [_scaled(p, share) for p in scenario.platform]
        words.append(f"the ground's motion to {100.0 * share:.0f} %")
    if found.push_share > 1.0:
        share = PUSH_SHARE / found.push_share
        changes["push"] = [_scaled_push(push, share) for push in scenario.push]
        words.append(f"pushes to {100.0 * share:.0f} %")
    if walk is not None and shortens:
        share = round(KEPT_SHARE * found.step_share, 2)
        slower = {name: share * pace for name, pace in paces.items()}
        changes["walk"] = msgspec.structs.replace(walk, **slower)
        words.append(f"the walk's velocity to {100.0 * share:.0f} %")
    told = f"{scenario.name} scaled to {robot.file.name}: {', '.join(words)}"
    return msgspec.structs.replace(scenario, **changes), told


def _scaled(platform: Platform, share: float) -> Platform:
    motions = []
    for motion in platform.motion:
        sizes = {
            name: share * value
            for name in _SIZES
            if (value := getattr(motion, name, None)) is not None
        }
        motions.append(msgspec.structs.replace(motion, **sizes))
    return msgspec.structs.replace(platform, motion=motions)


def _extremes(scenario: Scenario) -> list[Ground]:
    """Return extreme poses of the ground in z, roll, pitch and pairs of them."""
    tracks = {p.foot: _track(p, scenario.duration_s) for p in scenario.platform}
    if "both" in tracks:
        return [Ground(GroundPose(*pose)) for pose in _farthest(tracks["both"])]
    if not tracks:
        return []
    still = np.zeros_like(next(iter(tracks.values())))
    together = np.hstack([tracks.get(foot, still) for foot in ("left", "right")])
    return [
        Ground(GroundPose(*pose[:3]), GroundPose(*pose[3:]))
        for pose in _farthest(together)
    ]


def _steps(scenario: Scenario, robot: Robot) -> list[Vec3]:
    """Return the ways from the right to the left sole in a walk, (3,) each [m]."""
    assert scenario.walk is not None  # asked for walks only
    plan = plan_of(scenario.walk, robot, WalkSettings(), duration_s=scenario.duration_s)
    half = half_width_of(robot)
    feet = [Foothold(0.0, half, 0.0, 0.0), Foothold(0.0, -half, 0.0, 0.0)]
    ways = set()
    for step in plan.steps:
        x, y, z = step.position
        feet[SIDES.index(step.side)] = Foothold(x, y, z, step.yaw)
        left, right = feet
        middle = right._replace(yaw=mean_yaw(left.yaw, right.yaw))
        x, y, _ = left.seen_from(middle)
        ways.add((round(x, 3), round(y, 3), round(left.z - right.z, 3)))
    return [np.array(way) for way in sorted(ways)]


def _track(platform: Platform, duration_s: float) -> Mat:
    """Return (n, 3) z, roll and pitch over time [m, rad]; slow heaving is left out."""
    from scipy.signal import butter, sosfilt

    times = np.arange(0.0, duration_s + SAMPLE_S / 2.0, SAMPLE_S)
    track = np.zeros((len(times), len(_AXES)))
    for motion in platform.motion:
        if motion.axis not in _AXES:
            continue
        law = motion_law(motion)
        track[:, _AXES.index(motion.axis)] += [law(float(t))[0] for t in times]
    high = butter(2, FOLLOWED_HZ, "highpass", fs=1.0 / SAMPLE_S, output="sos")
    track[:, 0] = sosfilt(high, track[:, 0])
    return track


def _farthest(track: Mat) -> Mat:
    """Return the rows of a track that are extreme along an axis or a pair of axes."""
    size = np.abs(track).max(axis=0)
    moving = np.flatnonzero(size > 0.0)
    directions = [sign * np.eye(len(size))[i] for i in moving for sign in (-1.0, 1.0)]
    directions += [
        np.eye(len(size))[i] * a + np.eye(len(size))[j] * b
        for i in moving
        for j in moving
        if i < j
        for a in (-1.0, 1.0)
        for b in (-1.0, 1.0)
    ]
    unit = track / np.where(size > 0.0, size, 1.0)
    rows = sorted({int(np.argmax(unit @ direction)) for direction in directions})
    return track[rows]


def _push_share(scenario: Scenario, capture: Array) -> float:
    """Return the largest ratio of a push to the limit in its direction."""
    hardest = 0.0
    for push in scenario.push:
        if push.force_n is None:
            hardest = max(hardest, push.impulse_share or 0.0)
            continue
        x, y, _ = push.force_n
        impulse = push.duration_s * float(np.hypot(x, y))
        turn = len(capture) * (np.arctan2(y, x) / (2.0 * np.pi))
        limit = float(capture[round(turn) % len(capture)])
        hardest = max(hardest, impulse / limit if limit > 0.0 else np.inf)
    return hardest


def _scaled_push(push: Push, share: float) -> Push:
    """Return a push scaled by a factor."""
    if push.impulse_share is not None:
        return msgspec.structs.replace(push, impulse_share=share * push.impulse_share)
    assert push.force_n is not None  # one of them is given
    x, y, z = push.force_n
    return msgspec.structs.replace(push, force_n=(share * x, share * y, share * z))
