from __future__ import annotations

import itertools

import pytest

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.requests import EVERY_TICKS, RAMP_S, SettingsRamp

PERIOD_S = 0.001
TICKS = round(RAMP_S / PERIOD_S)
KP = ControllerSettings().tsid.com_kp[0]
TARGET = 2.0 * KP


@pytest.fixture
def ramp() -> SettingsRamp:
    return SettingsRamp(ControllerSettings(), period_s=PERIOD_S)


def begin(ramp: SettingsRamp, value: float, *, tick: int = 7) -> None:
    ramp.begin({"tsid.com_kp": [value]}, source="ann", tick=tick, stamp_ns=1)


def gains(ramp: SettingsRamp, ticks: int) -> list[float]:
    """Return the gain in use at each of a number of ticks."""
    found = []
    for _ in range(ticks):
        ramp.advance()
        found.append(ramp.settings.tsid.com_kp[0])
    return found


def test_a_gain_goes_up_in_small_steps_and_ends_where_it_was_asked_to(
    ramp: SettingsRamp,
) -> None:
    begin(ramp, TARGET)
    found = [KP, *gains(ramp, TICKS)]
    steps = [after - before for before, after in itertools.pairwise(found)]
    largest = (TARGET - KP) * EVERY_TICKS / TICKS
    assert all(0.0 <= step <= largest * (1 + 1e-9) for step in steps)
    assert found[-1] == TARGET
    assert not ramp.is_moving
    assert ramp.advance() is None


def test_a_new_wish_starts_from_where_the_gain_is(ramp: SettingsRamp) -> None:
    begin(ramp, TARGET)
    halfway = gains(ramp, TICKS // 2)[-1]
    assert KP < halfway < TARGET
    begin(ramp, KP)
    found = gains(ramp, TICKS)
    assert all(KP <= value <= halfway for value in found)
    assert found[-1] == KP
    assert ramp.changes[-1].before["tsid.com_kp"][0] == halfway


def test_a_wish_for_another_gain_keeps_the_first_one_going(ramp: SettingsRamp) -> None:
    begin(ramp, TARGET)
    gains(ramp, TICKS // 2)
    ramp.begin({"tsid.base_kp": [50.0]}, source="bob", tick=9, stamp_ns=2)
    gains(ramp, TICKS)
    assert ramp.settings.tsid.com_kp == (TARGET,) * 3
    assert ramp.settings.tsid.base_kp == 50.0


def test_a_refused_wish_leaves_everything_as_it_was(ramp: SettingsRamp) -> None:
    begin(ramp, TARGET)
    before = ramp.settings, ramp.targets
    for bad in ({}, {"tsid.com_kp": [-1.0]}, {"tsid.friction": [0.4]}):
        with pytest.raises(FileFormatError):
            ramp.begin(bad, source="eve", tick=8, stamp_ns=2)
    assert (ramp.settings, ramp.targets) == before
    assert len(ramp.changes) == 1


def test_a_change_says_who_when_and_from_what_to_what(ramp: SettingsRamp) -> None:
    begin(ramp, TARGET, tick=123)
    (change,) = ramp.changes
    assert (change.tick, change.source, change.ramp_s) == (123, "ann", RAMP_S)
    assert change.before == {"tsid.com_kp": [KP] * 3}
    assert change.after == {"tsid.com_kp": [TARGET] * 3}
