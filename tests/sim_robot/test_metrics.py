from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.sim_robot.metrics import PlantMetrics
from surefoot.sim_robot.state_view import PlantTruth

PERIOD_S = 0.001
WEIGHT_N = 700.0
START = PlantTruth(
    tick=0,
    base_position=np.array([0.0, 0.0, 1.1]),
    base_quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
    upright=1.0,
    com=np.array([0.012, 0.001, 0.74]),
    com_velocity=np.zeros(3),
    sole_left=np.array([0.026, 0.11, 0.0]),
    sole_right=np.array([0.026, -0.11, 0.0]),
    F_left=np.array([0.0, 0.0, 350.0, 0.0, 0.0, 0.0]),
    F_right=np.array([0.0, 0.0, 350.0, 0.0, 0.0, 0.0]),
    vertical_forces=(350.0, 350.0),
    platforms=(),
)


@pytest.fixture
def metrics() -> PlantMetrics:
    reference = START.com - [0.026, 0.0, 0.0]
    return PlantMetrics(reference, weight=WEIGHT_N, period_s=PERIOD_S)


def take(metrics: PlantMetrics, tick: int, **changes: Any) -> None:
    """Add a tick that equals the start except for some changes."""
    metrics.update(replace(START, tick=tick, **changes), tick=tick)


def carried(way: Array) -> dict[str, Array]:
    """Return the robot with its feet elsewhere."""
    names = ("com", "sole_left", "sole_right")
    return {name: getattr(START, name) + way for name in names}


def normal(force: float) -> np.ndarray:
    return np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])


def test_standing_like_the_start_is_no_error(metrics: PlantMetrics) -> None:
    for tick in range(1500):
        take(metrics, tick)
    figures = metrics.figures()
    np.testing.assert_allclose(figures["com_error_max_mm"], 0.0, atol=1e-15)
    np.testing.assert_array_equal(figures["force_deviation_rms_n"], 0.0)
    np.testing.assert_array_equal(figures["force_peak_n"], 350.0)
    np.testing.assert_array_equal(figures["contact_lost_s"], 0.0)
    assert figures["base_tilt_max_deg"] == 0.0


def test_ground_that_carries_the_robot_along_is_no_horizontal_error(
    metrics: PlantMetrics,
) -> None:
    for tick in range(1000, 1100):
        way = np.array([1e-3 * (tick - 900), -2e-3 * (tick - 900), 0.0])
        take(metrics, tick, **carried(way))
    np.testing.assert_allclose(metrics.figures()["com_error_max_mm"], 0.0, atol=1e-12)


def test_height_counts_in_the_world_even_if_the_soles_go_along(
    metrics: PlantMetrics,
) -> None:
    lift = np.array([0.0, 0.0, 0.03])
    take(metrics, 1000, **carried(lift))
    np.testing.assert_allclose(metrics.figures()["com_error_rms_mm"], [0, 0, 30.0])


def test_errors_are_root_mean_square_and_largest_magnitude(
    metrics: PlantMetrics,
) -> None:
    rng = np.random.default_rng(5)
    errors = 0.01 * rng.normal(size=(400, 3))
    for tick, error in enumerate(errors, start=1000):
        take(metrics, tick, com=START.com + error)
    figures = metrics.figures()
    np.testing.assert_allclose(
        figures["com_error_rms_mm"], 1e3 * np.sqrt(np.mean(errors**2, axis=0))
    )
    np.testing.assert_allclose(
        figures["com_error_max_mm"], 1e3 * np.abs(errors).max(axis=0)
    )


def test_first_second_does_not_count(metrics: PlantMetrics) -> None:
    for tick in range(1000):
        take(metrics, tick, com=START.com + 1.0, vertical_forces=(100.0, 100.0))
    figures = metrics.figures()
    assert figures["com_error_max_mm"] is None
    assert figures["force_deviation_rms_n"] is None


def test_force_deviation_is_against_half_the_weight(metrics: PlantMetrics) -> None:
    for tick in range(1000, 1010):
        take(metrics, tick, vertical_forces=(340.0, 380.0))
    np.testing.assert_allclose(metrics.figures()["force_deviation_rms_n"], [10.0, 30.0])


def test_force_peak_counts_from_a_fifth_of_a_second(metrics: PlantMetrics) -> None:
    take(metrics, 199, F_left=normal(2000.0))
    take(metrics, 200, F_right=normal(900.0))
    take(metrics, 201)
    np.testing.assert_array_equal(metrics.figures()["force_peak_n"], [350.0, 900.0])


def test_lost_contact_is_counted_in_seconds_from_the_start(
    metrics: PlantMetrics,
) -> None:
    for tick in range(100):
        lifted = 4.9 if tick < 30 else 5.1
        take(metrics, tick, F_right=normal(lifted))
    np.testing.assert_allclose(metrics.figures()["contact_lost_s"], [0.0, 0.03])


def test_tilt_is_the_largest_lean(metrics: PlantMetrics) -> None:
    lean = 0.2
    take(metrics, 1, upright=math.cos(lean))
    take(metrics, 2)
    assert metrics.figures()["base_tilt_max_deg"] == pytest.approx(math.degrees(lean))
