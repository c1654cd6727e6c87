"""The baseline's filters against hand-computed numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surefoot.stabilizer.zmp.dcm_feedback import (
    ExponentialMovingAverage,
    LeakyIntegrator,
)

EXACT = 1e-12


def test_average_after_one_time_constant_is_63_percent() -> None:
    average = ExponentialMovingAverage(time_constant_s=10.0, period_s=0.001)
    for _ in range(10_000):
        average.update(np.array([0.02, -0.01, 0.0]))
    rise = 1.0 - math.exp(-1.0)
    np.testing.assert_allclose(average.value, [0.02 * rise, -0.01 * rise, 0.0])


def test_average_of_a_constant_becomes_the_constant_and_no_more() -> None:
    """It is no integral: an error that stays for ever counts once."""
    average = ExponentialMovingAverage(time_constant_s=0.1, period_s=0.001)
    constant = np.array([0.02, -0.03, 0.0])
    for _ in range(5_000):
        average.update(constant)
        assert (np.abs(average.value) <= np.abs(constant)).all()
    np.testing.assert_allclose(average.value, constant, atol=EXACT)


def test_average_never_leaves_its_limit_and_comes_back_at_once() -> None:
    average = ExponentialMovingAverage(time_constant_s=0.1, period_s=0.001, limit=0.05)
    for _ in range(1_000):
        average.update(np.array([3.0, -3.0, 0.0]))
        assert np.abs(average.value).max() <= 0.05
    np.testing.assert_array_equal(average.value, [0.05, -0.05, 0.0])
    average.update(np.zeros(3))
    assert average.value[0] < 0.05


def test_average_does_not_depend_on_the_rate() -> None:
    values = []
    for period_s, ticks in ((0.005, 200), (0.001, 1_000)):
        average = ExponentialMovingAverage(time_constant_s=0.7, period_s=period_s)
        for _ in range(ticks):
            average.update(np.ones(3))
        values.append(average.value.copy())
    np.testing.assert_allclose(values[0], values[1], atol=EXACT)


def test_time_constant_has_a_floor_of_two_periods() -> None:
    average = ExponentialMovingAverage(time_constant_s=1e-9, period_s=0.001)
    assert average.update(np.ones(3))[0] == pytest.approx(1.0 - math.exp(-0.5))


def test_leaky_integral_of_a_constant_settles_at_rate_over_leak() -> None:
    integral = LeakyIntegrator(leak=2.0, limit=1.0, period_s=0.001)
    for _ in range(20_000):
        integral.update(np.array([0.1, 0.0, -0.1]))
    np.testing.assert_allclose(integral.value, [0.05, 0.0, -0.05], atol=EXACT)


def test_leaky_integral_is_clamped() -> None:
    integral = LeakyIntegrator(leak=0.1, limit=0.05, period_s=0.001)
    for _ in range(1_000):
        integral.update(np.array([1.0, -1.0, 0.0]))
    np.testing.assert_array_equal(integral.value, [0.05, -0.05, 0.0])
