"""The height of the centre of mass through a walk."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.estimation.contact import Anchors
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.walking.gait import HeightReference

DT = 1e-3


def follow(
    heights: HeightReference, stance: Any, height: float, anchors: Anchors
) -> None:
    """Continue by a tick over ground of a height between two standing feet."""
    levels = [np.array([0.0, 0.0, level]) for level in anchors.level]
    dynamics: Any = SimpleNamespace(p_sole=levels)
    anchors.carrying = 0.5 * sum(anchors.level)
    state: Any = SimpleNamespace(ground_height=height)
    heights.follow(
        stance, state, dynamics, anchors, under=None, middle_over_support=0.0
    )


def test_the_height_is_the_nominal_one_over_the_deepest_ground(walker: Robot) -> None:
    """A leg that lands is spread, and near to straight it would be slow."""
    heights = HeightReference(WalkSettings(), com_rise=0.08, period_s=DT)
    stance = standing(RobotModel(walker))
    asked = {}

    def approach_ground(ground: float, *, highest: float, share: float) -> None:
        asked["highest"] = highest

    stance.approach_ground = approach_ground  # type: ignore[method-assign]
    anchors = Anchors(stance.p_sole, stance.yaw_sole)
    for height in (0.0, -0.1, 0.1):
        follow(heights, stance, height, anchors)
    assert asked["highest"] == pytest.approx(-0.1, abs=0.001)


@pytest.mark.parametrize("level", [0.2, -0.15])
def test_stairs_of_the_plan_are_climbed_on_time(walker: Robot, level: float) -> None:
    """Smoothly, up to what the lower leg reaches; then with both feet all the way."""
    stance = standing(RobotModel(walker))
    rise, nominal = 0.08, stance.com_height
    heights = HeightReference(WalkSettings(), com_rise=rise, period_s=DT)
    anchors = Anchors(stance.p_sole, stance.yaw_sole)
    # As measured: the ground is where the plan has it.
    places = []
    for levels in ([0.0, level], [level, level]):
        anchors.level[:] = levels
        for _ in range(1000):
            follow(heights, stance, 0.5 * sum(levels), anchors)
            places.append((stance.com_height, stance.com_velocity.item(2)))
    height, velocity = np.array(places).T
    reach = min(0.5 * level, min(0.0, level) + rise)
    assert height[999] - nominal == pytest.approx(reach, abs=0.04)
    assert height[999] - nominal <= reach + 1e-6
    assert height[-1] - nominal == pytest.approx(level, abs=0.01)
    np.testing.assert_allclose(np.diff(height) / DT, velocity[1:], atol=1e-9)
    assert np.abs(np.diff(velocity) / DT).max() < 3.0
