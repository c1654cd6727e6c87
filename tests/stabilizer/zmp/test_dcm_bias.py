"""The DCM bias estimator against hand-computed numbers and a simulated pendulum."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.model import GRAVITY
from surefoot.stabilizer.zmp.dcm_feedback import (
    FIRST_STD_M,
    ORIGINAL_PERIOD_S,
    DcmBiasEstimator,
    DcmFeedback,
    StandingPendulum,
)

PERIOD_S = 0.001
OMEGA = 3.0
NOTHING = np.zeros(3)
BIAS = np.array([0.012, -0.007, 0.0])


def estimator(period_s: float = PERIOD_S, **settings: float) -> DcmBiasEstimator:
    return DcmBiasEstimator(ZmpSettings(**settings), period_s=period_s)


def watch_swaying(
    *, period_s: float, bias: Array, noise_m: float = 0.0, seconds: float = 20.0
) -> DcmBiasEstimator:
    """Feed a DCM that is brought back, with a bias added."""
    law = estimator(period_s)
    rng = np.random.default_rng(3)
    error = np.array([0.02, 0.01, 0.0])
    for tick in range(round(seconds / period_s)):
        sway = 0.01 * math.sin(2.0 * tick * period_s)
        zmp = 1.5 * error + np.array([sway, -sway, 0.0])
        noise = noise_m * rng.standard_normal(3) * (1.0, 1.0, 0.0)
        law.update(error + bias + noise, zmp, omega=OMEGA, yaw=0.0)
        growth = math.exp(OMEGA * period_s)
        error = growth * error + (1.0 - growth) * zmp
    return law


def test_begins_with_all_error_and_no_bias() -> None:
    law = estimator()
    law.update(BIAS, NOTHING, omega=OMEGA, yaw=0.0)
    np.testing.assert_array_equal(law.error, BIAS)
    np.testing.assert_array_equal(law.bias, NOTHING)


def test_second_update_by_hand() -> None:
    """Prediction, gain and correction of one axis, written out."""
    law = estimator()
    law.update(np.array([0.01, 0.0, 0.0]), np.array([0.03, 0.0, 0.0]), omega=3.0, yaw=0)
    law.update(np.array([0.02, 0.0, 0.0]), NOTHING, omega=3.0, yaw=0.0)

    a = math.exp(0.003)
    error = a * 0.01 + (1.0 - a) * 0.03
    variance_e = a * a * FIRST_STD_M**2 + 9.0 * 0.05**2 * ORIGINAL_PERIOD_S * PERIOD_S
    variance_b = FIRST_STD_M**2 + 0.02**2 * ORIGINAL_PERIOD_S * PERIOD_S
    scale = variance_e + variance_b + 0.01**2 * ORIGINAL_PERIOD_S / PERIOD_S
    surprise = 0.02 - error
    assert law.error[0] == pytest.approx(error + variance_e / scale * surprise)
    assert law.bias[0] == pytest.approx(variance_b / scale * surprise)
    assert law.covariance[0, 1] == pytest.approx(-variance_e * variance_b / scale)
    assert law.error[1] == law.bias[1] == 0.0


def test_finds_the_bias_of_a_swaying_pendulum() -> None:
    law = watch_swaying(period_s=PERIOD_S, bias=BIAS)
    np.testing.assert_allclose(law.bias, BIAS, atol=5e-4)


def test_finds_no_bias_where_there_is_none() -> None:
    law = watch_swaying(period_s=PERIOD_S, bias=NOTHING, noise_m=0.002)
    np.testing.assert_allclose(law.bias, NOTHING, atol=2e-3)


def test_any_rate_gives_the_same_filter() -> None:
    slow = watch_swaying(period_s=0.005, bias=BIAS, seconds=0.5)
    fast = watch_swaying(period_s=0.001, bias=BIAS, seconds=0.5)
    np.testing.assert_allclose(fast.covariance, slow.covariance, rtol=0.05)
    np.testing.assert_allclose(fast.bias, slow.bias, atol=5e-4)


def test_bias_turns_with_the_base() -> None:
    law = watch_swaying(period_s=PERIOD_S, bias=BIAS)
    law.update(law.error + law.bias, NOTHING, omega=OMEGA, yaw=0.0)
    x, y, _ = law.bias
    turned = np.array([-y, x, 0.0])
    # The turned robot sees what the turned bias predicts, so there is no surprise.
    predicted = math.exp(OMEGA * PERIOD_S) * law.error
    law.update(predicted + turned, NOTHING, omega=OMEGA, yaw=0.5 * math.pi)
    np.testing.assert_allclose(law.bias, turned, atol=1e-9)


def test_limit_is_along_the_axes_of_the_base_and_what_it_cuts_is_error() -> None:
    law = estimator(dcm_measure_error_std_m=1e-6, bias_limit_m=0.02)
    eighth = 0.25 * math.pi
    for far in (1.0, 1.2, 1.4):
        seen = np.array([far, 0.0, 0.0])
        law.update(seen, seen, omega=OMEGA, yaw=eighth)
    own_x = math.cos(eighth) * law.bias[0] + math.sin(eighth) * law.bias[1]
    assert abs(own_x) == pytest.approx(0.02)
    np.testing.assert_allclose(law.error + law.bias, seen, atol=1e-4)


def test_begins_anew_after_a_reset() -> None:
    law = watch_swaying(period_s=PERIOD_S, bias=BIAS)
    law.reset()
    law.update(NOTHING, NOTHING, omega=OMEGA, yaw=0.0)
    np.testing.assert_array_equal(law.bias, NOTHING)
    assert law.covariance[0, 0] == pytest.approx(FIRST_STD_M**2)


def standing_offset(correction: Literal["off", "bias", "filter"]) -> float:
    """Return where a pendulum rests [m] whose CoM is seen 12 mm ahead of the truth."""
    height = GRAVITY / OMEGA**2
    pendulum = StandingPendulum(np.array([0.0, 0.0, height]), period_s=PERIOD_S)
    law = DcmFeedback(
        ZmpSettings(dcm_prop_gain=3.0, dcm_integral_gain=0.0, dcm_bias=correction),
        period_s=PERIOD_S,
    )
    com, speed = np.array([0.0, 0.0, height]), np.zeros(3)
    zmp = np.zeros(3)
    seen = np.array([0.012, 0.0, 0.0])
    for _ in range(20_000):
        desired = law.update(
            pendulum, com=com + seen, velocity=speed, zmp=zmp, in_air=False
        )
        zmp = com - desired / OMEGA**2
        zmp[2] = 0.0
        com = com + PERIOD_S * speed * (1.0, 1.0, 0.0)
        speed = speed + PERIOD_S * OMEGA**2 * (com - zmp) * (1.0, 1.0, 0.0)
    return float(com[0])


@pytest.mark.closed_loop
def test_a_corrected_robot_stands_where_it_should() -> None:
    """Uncorrected, it stands as far behind as it is seen ahead, nearly."""
    assert standing_offset("off") < -0.010
    assert abs(standing_offset("bias")) < 0.001
    assert abs(standing_offset("filter")) < 0.001


def test_in_the_air_the_filter_forgets() -> None:
    pendulum = StandingPendulum(np.array([0.0, 0.0, 1.0]), period_s=PERIOD_S)
    law = DcmFeedback(ZmpSettings(dcm_bias="bias"), period_s=PERIOD_S)
    com = np.array([0.01, 0.0, 1.0])
    for _ in range(50):
        law.update(pendulum, com=com, velocity=NOTHING, zmp=NOTHING, in_air=False)
    assert law.estimator.bias[0] != 0.0
    law.update(pendulum, com=com, velocity=NOTHING, zmp=NOTHING, in_air=True)
    assert law.estimator.bias[0] == 0.0
