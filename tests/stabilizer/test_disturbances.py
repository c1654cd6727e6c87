"""Pushes and fast ground that tip a foot, in closed loop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot, load_robot
from tests.stabilizer.closed_loop import run_closed_loop

pytestmark = pytest.mark.closed_loop

PUSH_S = 0.1
IMPULSE_NS = 20.0
HARD_LANDING_N = 1500.0
"""More than four times a foot's share of the weight."""
NORMAL_ROWS = (2, 8)


def push(
    direction_deg: float, *, impulse_n_s: float = IMPULSE_NS
) -> list[dict[str, Any]]:
    """Return a push on the torso; its direction counts from ahead to the left."""
    angle, force = math.radians(direction_deg), impulse_n_s / PUSH_S
    force_n = [force * math.cos(angle), force * math.sin(angle), 0.0]
    return [{"body": "torso", "force_n": force_n, "start_s": 1.0, "duration_s": PUSH_S}]


def ramp(axis: str, rate_deg_s: float) -> list[dict[str, Any]]:
    """Return a platform under both feet that turns by 15 deg and stays there."""
    motion = {
        "axis": axis,
        "kind": "ramp",
        "amplitude_deg": 15.0,
        "rate_deg_s": rate_deg_s,
        "start_s": 1.0,
    }
    return [{"foot": "both", "motion": [motion]}]


def test_push_to_the_side_ends_without_a_foot_rocking(walker: Robot) -> None:
    """A foot pushed onto its edge must not take its own tipping for the ground's."""
    run = run_closed_loop(walker, duration_s=2.8, push=push(135.0))
    assert not run.fell
    assert run.F_true[:, NORMAL_ROWS].max() < HARD_LANDING_N


def test_pushed_onto_one_foot_it_does_not_count_on_swinging_the_other_leg(
    walker: Robot,
) -> None:
    run = run_closed_loop(walker, duration_s=2.8, push=push(90.0, impulse_n_s=38.0))
    assert not run.fell


def test_ground_that_tilts_faster_than_the_paper_dared() -> None:
    robot = load_robot("walker", servo_profile="harmonic")
    run = run_closed_loop(robot, duration_s=3.0, platform=ramp("roll", 120.0))
    assert not run.fell
    assert np.isfinite(run.commands).all()
