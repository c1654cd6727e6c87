"""A wrench is the same in whatever frame it is written."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from surefoot.stabilizer.estimation.wrenches import wrench_shift

SAMPLES = 50
TOLERANCE = 1e-12


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def random_placement(rng: np.random.Generator) -> pin.SE3:
    quat = rng.normal(size=4)
    rotation = pin.Quaternion(quat / np.linalg.norm(quat)).toRotationMatrix()
    return pin.SE3(rotation, rng.normal(size=3))


def shift(T_a_b: pin.SE3) -> np.ndarray:
    """Return (6, 6) from frame a to frame b."""
    return wrench_shift(T_a_b.rotation, T_a_b.translation)


def test_map_is_the_transposed_map_of_twists(rng: np.random.Generator) -> None:
    for _ in range(SAMPLES):
        T_sensor_sole = random_placement(rng)
        np.testing.assert_allclose(
            shift(T_sensor_sole), T_sensor_sole.action.T, atol=TOLERANCE
        )


def test_two_shifts_are_one(rng: np.random.Generator) -> None:
    for _ in range(SAMPLES):
        T_a_b, T_b_c = random_placement(rng), random_placement(rng)
        np.testing.assert_allclose(
            shift(T_b_c) @ shift(T_a_b), shift(T_a_b * T_b_c), atol=10 * TOLERANCE
        )


def test_force_above_the_sole_presses_the_side_it_pushes_to() -> None:
    """Ankle pushed forward, 0.1 m up: the toe is loaded, a moment about +y."""
    ankle_to_sole = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    forward = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(
        shift(ankle_to_sole) @ forward, [1.0, 0.0, 0.0, 0.0, 0.1, 0.0], atol=TOLERANCE
    )
