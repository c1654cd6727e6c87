"""The rows of a sole's limits allow exactly what a sole can transmit."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import TsidSettings
from surefoot.stabilizer.control.tsid import cone_rows

HALF_LENGTH, HALF_WIDTH = 0.13, 0.07
SETTINGS = TsidSettings()
CORNERS = SETTINGS.sole_scale * np.array(
    [
        [x, y, 0.0]
        for x in (-HALF_LENGTH, HALF_LENGTH)
        for y in (-HALF_WIDTH, HALF_WIDTH)
    ]
)
SAMPLES = 200
ROUNDING = 1e-9
CONE_ROWS = slice(0, 10)
"""All rows except the two that bound the normal force."""


@pytest.fixture
def rows() -> Array:
    return cone_rows(SETTINGS, HALF_LENGTH, HALF_WIDTH)


def excess(rows: Array, F: Array) -> float:
    """Return the largest violation; negative inside."""
    return float((rows[CONE_ROWS] @ F).max())


def wrench_of(forces: Array) -> Array:
    """Return (6,) the wrench of a force at each of the four corners, (4, 3)."""
    return np.concatenate((forces.sum(axis=0), np.cross(CORNERS, forces).sum(axis=0)))


def test_pressing_corners_inside_the_pyramid_is_allowed(rows: Array) -> None:
    rng = np.random.default_rng(11)
    side = SETTINGS.friction / np.sqrt(2.0)
    for _ in range(SAMPLES):
        forces = rng.uniform(0.0, 100.0, size=(4, 3))
        forces[:, :2] = forces[:, 2:] * rng.uniform(-side, side, size=(4, 2))
        F = wrench_of(forces)
        # The yaw moment has a limit of its own, tighter than the corners'.
        F[5] = 0.0
        assert excess(rows, F) <= ROUNDING


def test_what_is_allowed_lies_inside_the_round_friction_cone(rows: Array) -> None:
    rng = np.random.default_rng(12)
    allowed = 0
    for _ in range(SAMPLES):
        F = np.array([*rng.uniform(-1.0, 1.0, size=2), 1.0, 0.0, 0.0, 0.0])
        if excess(rows, F) <= 0.0:
            allowed += 1
            assert np.hypot(F[0], F[1]) <= SETTINGS.friction + ROUNDING
    assert 0 < allowed < SAMPLES


@pytest.mark.parametrize("corner", range(4))
def test_force_just_past_a_corner_is_refused(rows: Array, corner: int) -> None:
    force = np.array([0.0, 0.0, 100.0])
    for scale, inside in ((0.999, True), (1.001, False)):
        F = np.concatenate((force, np.cross(scale * CORNERS[corner], force)))
        assert (excess(rows, F) <= 0.0) is inside


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_yaw_moment_is_bounded_by_the_load(rows: Array, sign: float) -> None:
    limit = SETTINGS.yaw_friction * 100.0
    F = np.array([0.0, 0.0, 100.0, 0.0, 0.0, sign * limit])
    assert excess(rows, 0.999 * F) <= 0.0
    F[5] *= 1.001
    assert excess(rows, F) > 0.0


def test_pulling_is_refused(rows: Array) -> None:
    assert excess(rows, np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])) > 0.0


def test_last_rows_measure_the_normal_force(rows: Array) -> None:
    F = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    np.testing.assert_array_equal(rows[10:] @ F, [3.0, -3.0])
