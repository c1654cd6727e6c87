"""CoM admittance: direction, number, clamp, and its pause."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.zmp.foot_admittance import ZmpCompensation

PERIOD_S = 0.001
SETTINGS = ZmpSettings(com_admittance=(0.5, 0.25))
ZMP = np.array([0.02, 0.04, 0.0])


def updated(*, ticks: int, active: bool = True) -> ZmpCompensation:
    law = ZmpCompensation(SETTINGS, period_s=PERIOD_S)
    for _ in range(ticks):
        law.update(distributed=np.zeros(3), measured=ZMP, active=active)
    return law


def test_com_moves_towards_the_excess_of_the_measured_zmp() -> None:
    law = updated(ticks=1)
    np.testing.assert_allclose(law.velocity, [0.01, 0.01, 0.0])
    np.testing.assert_allclose(law.offset, [1e-5, 1e-5, 0.0])
    np.testing.assert_allclose(law.acceleration, law.velocity / PERIOD_S)


def test_constant_error_has_no_acceleration() -> None:
    np.testing.assert_allclose(updated(ticks=2).acceleration, 0.0)


def test_offset_is_clamped() -> None:
    offset = updated(ticks=20_000).offset
    assert offset[0] == pytest.approx(SETTINGS.max_com_offset_m)


def test_with_a_foot_lifted_it_does_nothing() -> None:
    law = updated(ticks=10, active=False)
    np.testing.assert_array_equal(law.offset, 0.0)


def test_published_gain_of_zero_switches_it_off() -> None:
    law = ZmpCompensation(ZmpSettings(com_admittance=(0.0, 0.0)), period_s=PERIOD_S)
    law.update(distributed=np.zeros(3), measured=ZMP, active=True)
    np.testing.assert_array_equal(law.offset, 0.0)
