"""Ground that accelerates horizontally: the estimate, and the robot's response."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.runs import simulate
from surefoot.schemas.arrays import Array
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.stabilizer.estimation.felt_motion import FEIGNED_M_S2, GroundAcceleration

PERIOD_S = 0.001
PULL_M_S2 = 1.2
"""Acceleration that moves the centre of pressure by 8 cm, well within the sole."""
Signal = Callable[[float], float]


def observed(
    ground: Signal, sway: Signal, *, firm_until_s: float = 9.0, duration_s: float = 3.0
) -> Array:
    """Return the estimate of the ground's acceleration along x at every tick.

    Args:
        ground: true acceleration of the ground [m/s^2].
        sway: velocity of the CoM over the feet [m/s].
        firm_until_s: time at which the feet are lifted [s].
        duration_s: duration [s].
    """
    observer = GroundAcceleration(period_s=PERIOD_S)
    rows = []
    for time_s in PERIOD_S * np.arange(round(duration_s / PERIOD_S)):
        gained = (sway(time_s + PERIOD_S) - sway(time_s)) / PERIOD_S
        felt = ground(time_s) + gained
        is_firm = time_s < firm_until_s
        observer.update((felt, 0.0), (sway(time_s), 0.0), firm=is_firm)
        rows.append(observer.acceleration[0])
    return np.array(rows)


@pytest.mark.parametrize("pull", [-1.0, 0.6, 2.0])
def test_a_pull_is_told_but_for_what_a_tilt_may_feign(pull: float) -> None:
    told = observed(lambda t: pull * (t > 1.0), lambda t: 0.0)
    assert not told[:1000].any()
    sure = math.copysign(abs(pull) - FEIGNED_M_S2, pull)
    assert told[1400:] == pytest.approx(sure, abs=0.05)


def test_a_stop_long_after_a_start_is_told_as_soon() -> None:
    def ride(time_s: float) -> float:
        return 1.0 * (0.1 < time_s < 0.4) - 1.0 * (time_s > 7.6)

    told = observed(ride, lambda t: 0.0, duration_s=8.0)
    assert told[390] > 0.5
    assert told[7890] == pytest.approx(-told[390], rel=0.02)


def test_swaying_over_ground_that_rests_is_no_pull() -> None:
    told = observed(lambda t: 0.0, lambda t: 0.3 * math.sin(6.0 * t))
    assert not told.any()


def test_feet_in_the_air_tell_nothing() -> None:
    told = observed(lambda t: 1.0, lambda t: 0.0, firm_until_s=2.0)
    assert told[1999] > 0.5
    assert not told[2001:].any()


def pulled(walker: Robot, direction_deg: float, profile: str) -> RunResult:
    """Return a vehicle that starts within half a second and keeps accelerating."""
    angle = math.radians(direction_deg)
    speed_s = 0.5
    motion = [
        {
            "axis": axis,
            "kind": "sine",
            # The middle part of a slow swing is a nearly constant acceleration.
            "amplitude_m": PULL_M_S2 * part / (2.0 * math.pi * 0.25) ** 2,
            "frequency_hz": 0.25,
            "start_s": speed_s,
        }
        for axis, part in (("x", math.cos(angle)), ("y", math.sin(angle)))
        if abs(part) > 1e-6
    ]
    table = {
        "name": "pull",
        "duration_s": 5.0,
        "platform": [{"foot": "both", "motion": motion}],
        "sensors": {"force_noise_n": 2.0, "accel_noise_m_s2": 0.05},
    }
    scenario = scenario_from_table(table, source="test")
    return simulate(walker, scenario, servo_profile=profile, record=False).result


@pytest.mark.usual("180.0-harmonic")
@pytest.mark.parametrize(
    ("direction_deg", "profile"), [(0.0, "ideal"), (180.0, "harmonic")]
)
def test_the_robot_goes_along_with_ground_that_pulls(
    walker: Robot, direction_deg: float, profile: str
) -> None:
    """Told by the error alone it trails by 40 mm, and falls at 1.5 m/s^2."""
    result = pulled(walker, direction_deg, profile)
    assert not result.fell
    assert result.com_error_max_mm is not None
    assert max(result.com_error_max_mm[:2]) < 32.0
