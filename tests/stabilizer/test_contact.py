"""Contact states: hysteresis in force, waiting times, gentle reloading."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from surefoot.schemas.settings import ContactSettings
from surefoot.stabilizer.estimation.contact import ContactMonitor

PERIOD_S = 0.001
LARGEST_N = 1400.0
SETTINGS = ContactSettings()
STANDING_N = 343.0
BETWEEN_N = 0.5 * (SETTINGS.lost_below_n + SETTINGS.regained_above_n)
ROUNDING_TICKS = 1
SIDES = pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])


def make_monitor(settings: ContactSettings = SETTINGS) -> ContactMonitor:
    return ContactMonitor(settings, largest_force=LARGEST_N, period_s=PERIOD_S)


def feel(monitor: ContactMonitor, *, side: int, normal: float, ticks: int = 1) -> None:
    """Apply a normal force to one foot while the other stands firmly."""
    normals = [STANDING_N, STANDING_N]
    normals[side] = normal
    for _ in range(ticks):
        monitor.update(*normals)


def ticks_until(
    monitor: ContactMonitor, *, side: int, normal: float, in_contact: bool
) -> int:
    """Return how many ticks of a force a change takes."""
    for tick in range(1, 1000):
        feel(monitor, side=side, normal=normal)
        if monitor.in_contact[side] is in_contact:
            return tick
    raise AssertionError(f"contact is not {in_contact} after 1000 ticks of {normal} N")


def lifted(*, side: int) -> ContactMonitor:
    monitor = make_monitor()
    ticks_until(monitor, side=side, normal=0.0, in_contact=False)
    return monitor


def test_both_feet_stand_at_first() -> None:
    monitor = make_monitor()
    assert monitor.in_contact == [True, True]
    np.testing.assert_array_equal(monitor.allowed, LARGEST_N)


@SIDES
def test_contact_is_lost_after_its_time_and_no_sooner(side: int) -> None:
    ticks = ticks_until(make_monitor(), side=side, normal=0.0, in_contact=False)
    patience = SETTINGS.lost_after_s / PERIOD_S
    assert patience < ticks <= patience + 1 + ROUNDING_TICKS


@SIDES
def test_contact_is_regained_after_its_time_and_no_sooner(side: int) -> None:
    monitor = lifted(side=side)
    ticks = ticks_until(monitor, side=side, normal=STANDING_N, in_contact=True)
    patience = SETTINGS.regained_after_s / PERIOD_S
    assert patience < ticks <= patience + 1 + ROUNDING_TICKS


@SIDES
def test_one_foot_does_not_lift_the_other(side: int) -> None:
    monitor = lifted(side=side)
    assert monitor.in_contact[1 - side]
    assert monitor.allowed[1 - side] == LARGEST_N


@SIDES
def test_between_the_thresholds_everything_stays(side: int) -> None:
    standing, hanging = make_monitor(), lifted(side=side)
    for monitor, expected in ((standing, True), (hanging, False)):
        feel(monitor, side=side, normal=BETWEEN_N, ticks=500)
        assert monitor.in_contact[side] is expected


@SIDES
def test_a_short_bounce_starts_the_clock_anew(side: int) -> None:
    """Losing the ground again and again, each time too briefly, is standing."""
    monitor = make_monitor()
    briefly = int(SETTINGS.lost_after_s / PERIOD_S) - 1
    assert briefly > 0
    for _ in range(20):
        feel(monitor, side=side, normal=0.0, ticks=briefly)
        assert monitor.in_contact[side]
        feel(monitor, side=side, normal=STANDING_N)


@SIDES
def test_a_foot_that_touched_down_is_loaded_gradually(side: int) -> None:
    monitor = lifted(side=side)
    touch = SETTINGS.regained_above_n + 1.0
    ticks_until(monitor, side=side, normal=touch, in_contact=True)
    allowed = [float(monitor.allowed[side])]
    ticks = round(SETTINGS.reload_s / PERIOD_S)
    for _ in range(ticks + ROUNDING_TICKS):
        feel(monitor, side=side, normal=touch)
        allowed.append(float(monitor.allowed[side]))
    assert allowed[0] < 0.1 * LARGEST_N
    assert (np.diff(allowed) >= 0.0).all()
    largest_step = LARGEST_N * PERIOD_S / SETTINGS.reload_s
    # The first step also takes in what the foot carries already.
    assert np.diff(allowed)[1:].max() <= largest_step * (1.0 + 1e-9)
    assert allowed[ticks // 2] < 0.6 * LARGEST_N
    assert allowed[-1] == LARGEST_N


@SIDES
def test_a_foot_may_keep_what_it_carries_already(side: int) -> None:
    monitor = lifted(side=side)
    carried = 0.5 * LARGEST_N
    ticks_until(monitor, side=side, normal=carried, in_contact=True)
    feel(monitor, side=side, normal=carried)
    assert carried <= monitor.allowed[side] <= LARGEST_N


@SIDES
def test_losing_contact_takes_the_load_away(side: int) -> None:
    assert lifted(side=side).allowed[side] == 0.0


def test_thresholds_that_almost_touch_still_make_up_their_mind() -> None:
    settings = msgspec.structs.replace(
        SETTINGS, lost_below_n=30.0, regained_above_n=30.1
    )
    monitor = make_monitor(settings)
    ticks_until(monitor, side=0, normal=29.0, in_contact=False)
    ticks_until(monitor, side=0, normal=31.0, in_contact=True)
