"""DCM feedback and its reference pendulum, against hand-computed numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.model import GRAVITY
from surefoot.stabilizer.zmp.dcm_feedback import DcmFeedback, StandingPendulum

PERIOD_S = 0.001
HEIGHT = GRAVITY / 9.0
"""Height at which omega is 3 rad/s [m]."""
COM = np.array([0.0, 0.0, HEIGHT])
STILL = np.zeros(3)
GROUND = np.zeros(3)
EXACT = 1e-12


@pytest.fixture
def pendulum() -> StandingPendulum:
    return StandingPendulum(COM, period_s=PERIOD_S)


def beside(x: float, y: float, z: float) -> Array:
    """Return (3,) the reference's CoM plus an offset."""
    return COM + np.array([x, y, z])


def feedback(**gains: float) -> DcmFeedback:
    none = {"dcm_prop_gain": 0.0, "dcm_integral_gain": 0.0, "dcm_deriv_gain": 0.0}
    return DcmFeedback(ZmpSettings(**{**none, **gains}), period_s=PERIOD_S)


def test_at_the_reference_nothing_is_wanted(pendulum: StandingPendulum) -> None:
    law = feedback(dcm_prop_gain=5.0, dcm_integral_gain=10.0, dcm_deriv_gain=0.5)
    desired = law.update(pendulum, com=COM, velocity=STILL, zmp=GROUND, in_air=False)
    np.testing.assert_allclose(desired, 0.0, atol=EXACT)


def test_position_error_acts_through_omega_and_kp(pendulum: StandingPendulum) -> None:
    """10 mm ahead, at rest: 3 * 5 * 0.01 backwards."""
    com = beside(0.01, 0.0, 0.02)
    desired = feedback(dcm_prop_gain=5.0).update(
        pendulum, com=com, velocity=STILL, zmp=GROUND, in_air=False
    )
    np.testing.assert_allclose(desired, [-0.15, 0.0, 0.0], atol=EXACT)


def test_velocity_acts_in_the_dcm_and_by_itself(pendulum: StandingPendulum) -> None:
    """e_y = -0.03 / 3; cdd_y = 3 (5 e_y - 0.03). Vertical speed: without kp."""
    desired = feedback(dcm_prop_gain=5.0).update(
        pendulum,
        com=COM,
        velocity=np.array([0.0, 0.03, 0.1]),
        zmp=GROUND,
        in_air=False,
    )
    np.testing.assert_allclose(desired, [0.0, -0.24, -0.3], atol=EXACT)


def test_average_acts_through_omega_and_ki(pendulum: StandingPendulum) -> None:
    law = feedback(dcm_integral_gain=10.0)
    com = beside(0.01, 0.0, 0.0)
    desired = law.update(pendulum, com=com, velocity=STILL, zmp=GROUND, in_air=False)
    average = -0.01 * (1.0 - math.exp(-PERIOD_S / 10.0))
    assert desired[0] == pytest.approx(3.0 * 10.0 * average, rel=1e-9)


def test_average_never_asks_for_more_than_its_clamp(
    pendulum: StandingPendulum,
) -> None:
    law = DcmFeedback(
        ZmpSettings(
            dcm_prop_gain=0.0,
            dcm_integral_gain=10.0,
            dcm_deriv_gain=0.0,
            dcm_integrator_time_constant_s=0.01,
        ),
        period_s=PERIOD_S,
    )
    for _ in range(200):
        desired = law.update(
            pendulum,
            com=beside(1.0, 0.0, 0.0),
            velocity=STILL,
            zmp=GROUND,
            in_air=False,
        )
    assert desired[0] == pytest.approx(-3.0 * 10.0 * 0.05)


def test_derivator_sees_the_models_dcm_speed_and_forgets_an_offset(
    pendulum: StandingPendulum,
) -> None:
    law = feedback(dcm_deriv_gain=0.5)
    zmp = np.array([0.02, 0.0, 0.0])
    blend = 1.0 - math.exp(-PERIOD_S / ZmpSettings().dcm_derivator_time_constant_s)
    first = law.update(pendulum, com=COM, velocity=STILL, zmp=zmp, in_air=False)
    # omega (e - (z_d - z)) = 3 * 0.02, less its own average.
    assert first[0] == pytest.approx(3.0 * 0.5 * 0.06 * (1.0 - blend))
    for _ in range(20_000):
        last = law.update(pendulum, com=COM, velocity=STILL, zmp=zmp, in_air=False)
    assert abs(last[0]) < 1e-6


def test_in_the_air_the_memory_is_not_fed(pendulum: StandingPendulum) -> None:
    law = feedback(dcm_integral_gain=10.0, dcm_deriv_gain=0.5)
    law.update(
        pendulum, com=beside(0.1, 0.0, 0.0), velocity=STILL, zmp=GROUND, in_air=False
    )
    before = law.average.value.copy()
    law.update(
        pendulum, com=beside(0.1, 0.0, 0.0), velocity=STILL, zmp=GROUND, in_air=True
    )
    assert abs(law.average.value[0]) < abs(before[0])
    np.testing.assert_array_equal(law.offset.value, 0.0)


def test_pendulum_at_rest_stays(pendulum: StandingPendulum) -> None:
    for _ in range(100):
        pendulum.update(COM)
    np.testing.assert_allclose(pendulum.com, COM, atol=EXACT)
    np.testing.assert_allclose(pendulum.zmp, GROUND, atol=EXACT)
    assert pendulum.omega == pytest.approx(3.0)


def test_pendulum_leans_away_before_it_moves(pendulum: StandingPendulum) -> None:
    """Cdd = 5 * 0.1, lambda = 9: the ZMP goes 0.5 / 9 the other way."""
    pendulum.update(beside(0.1, 0.0, 0.0))
    assert pendulum.zmp[0] == pytest.approx(-0.5 / 9.0)
    for _ in range(10_000):
        pendulum.update(beside(0.1, 0.0, 0.0))
    np.testing.assert_allclose(pendulum.com, beside(0.1, 0.0, 0.0), atol=1e-6)
