"""Figures of step responses with a known course."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.bench.sway_response import step_figures
from surefoot.schemas.arrays import Array

START_S, LAG_S, SIZE = 1.0, 0.5, -4.0
STEP_S = 0.001
TOLERANCE_S = 2.0 * STEP_S


def course(shape: Array, since: Array) -> Array:
    return np.where(since < 0.0, 0.0, SIZE * shape) + 11.0


def test_a_lag_is_late_by_its_time_constant_and_never_overshoots() -> None:
    time_s = np.arange(0.0, 8.0, STEP_S)
    since = time_s - START_S
    left = np.exp(-np.maximum(since, 0.0) / LAG_S)
    ground = course(np.ones_like(since), since)
    found = step_figures(
        time_s, ground, course(left, since), course(1.0 - left, since), start_s=START_S
    )
    assert found.delay_s == pytest.approx(LAG_S * np.log(2.0), abs=TOLERANCE_S)
    assert found.rise_s == pytest.approx(LAG_S * np.log(10.0), abs=TOLERANCE_S)
    assert found.settling_s == pytest.approx(LAG_S * np.log(50.0), abs=TOLERANCE_S)
    assert found.overshoot == pytest.approx(0.0, abs=1e-4)
    assert found.sway_peak == pytest.approx(1.0, abs=1e-6)
    assert found.sway_final == pytest.approx(0.0, abs=1e-4)


def test_what_the_start_did_before_the_step_does_not_count() -> None:
    time_s = np.arange(0.0, 8.0, STEP_S)
    since = time_s - START_S
    left = np.exp(-np.maximum(since, 0.0) / LAG_S)
    ground = course(np.ones_like(since), since)
    sway, answer = course(left, since), course(1.0 - left, since)
    came_to_rest = np.where(since < -0.2, 0.7 * SIZE, 0.0)
    from_rest = step_figures(time_s, ground, sway, answer, start_s=START_S)
    from_a_start = step_figures(
        time_s, ground, sway + came_to_rest, answer - came_to_rest, start_s=START_S
    )
    assert from_a_start == from_rest


def test_what_rings_for_good_has_not_settled() -> None:
    time_s = np.arange(0.0, 8.0, STEP_S)
    since = time_s - START_S
    ring = 0.3 * np.sin(2.0 * np.pi * since)
    found = step_figures(
        time_s,
        course(np.ones_like(since), since),
        course(ring, since),
        course(1.0 - ring, since),
        start_s=START_S,
    )
    assert found.settling_s is None
    assert found.overshoot == pytest.approx(0.3, abs=1e-3)
    assert found.sway_peak == pytest.approx(0.3, abs=1e-3)
    assert found.sway_peak_s == pytest.approx(0.25, abs=TOLERANCE_S)


def test_a_robot_that_goes_with_the_ground_gives_no_answer() -> None:
    time_s = np.arange(0.0, 8.0, STEP_S)
    since = time_s - START_S
    ground = course(np.ones_like(since), since)
    found = step_figures(time_s, ground, ground, np.zeros_like(ground), start_s=START_S)
    assert found.sway_final == pytest.approx(1.0)
    assert (found.delay_s, found.rise_s, found.overshoot) == (None, None, None)
