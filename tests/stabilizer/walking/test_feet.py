"""Each foot changes its state only as its force allows."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.settings import ContactSettings, WalkSettings
from surefoot.stabilizer.estimation.contact import Anchors, ContactMonitor
from surefoot.stabilizer.walking.feet import Feet, FootState

DT, LARGEST_N, FIRM_N = 0.001, 1400.0, 600.0
SETTINGS = WalkSettings()
SIDES = pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])


class Stand:
    """Two feet with their monitor and anchors."""

    def __init__(self) -> None:
        self.contacts = ContactMonitor(
            ContactSettings(), largest_force=LARGEST_N, period_s=DT
        )
        self.anchors = Anchors([np.zeros(3), np.zeros(3)], [0.0, 0.0])
        self.feet = Feet(
            SETTINGS,
            self.contacts,
            self.anchors,
            weight=700.0,
            largest_force=LARGEST_N,
            period_s=DT,
        )

    def feel(self, side: int, force: float, *, time_s: float, may: bool = True) -> int:
        """Apply a force to one foot for a while; return how often it touched down."""
        touched = 0
        for _ in range(round(time_s / DT)):
            normals = (force, FIRM_N) if side == 0 else (FIRM_N, force)
            self.contacts.update(*normals)
            self.feet.update(normals, may_touch=may)
            touched += self.feet.touched[side]
        return touched


@pytest.fixture
def stand() -> Stand:
    return Stand()


@SIDES
def test_a_foot_that_is_to_leave_is_not_searched_for(stand: Stand, side: int) -> None:
    stand.feet.leave(side)
    stand.feel(side, 0.0, time_s=0.1)
    assert stand.contacts.in_contact[side]


@SIDES
def test_a_lifted_foot_touches_down_once(stand: Stand, side: int) -> None:
    stand.feet.lift(side)
    assert not stand.contacts.in_contact[side]
    assert not stand.anchors.planted[side]
    assert stand.feel(side, 100.0, time_s=0.05, may=False) == 0
    assert stand.feel(side, 100.0, time_s=0.05) == 1
    assert stand.feet.states[side] is FootState.LANDING
    assert stand.contacts.in_contact[side]


@SIDES
def test_a_spike_of_one_tick_is_no_touchdown(stand: Stand, side: int) -> None:
    stand.feet.lift(side)
    for _ in range(20):
        stand.feel(side, 200.0, time_s=DT)
        stand.feel(side, 0.0, time_s=DT)
    assert stand.feet.states[side] is FootState.SWING


@SIDES
def test_a_landing_foot_is_planted_after_its_time(stand: Stand, side: int) -> None:
    stand.feet.lift(side)
    stand.feel(side, 100.0, time_s=0.02)
    assert not stand.anchors.planted[side]
    stand.feet.settle(side)
    assert stand.feet.states[side] is FootState.LANDING
    stand.feel(side, 300.0, time_s=SETTINGS.landing_s)
    assert stand.anchors.planted[side]
    stand.feet.settle(side)
    assert stand.feet.states[side] is FootState.PLANTED
    assert not stand.contacts.owned[side]


@SIDES
def test_a_bounce_is_a_landing_again_and_no_other_touchdown(
    stand: Stand, side: int
) -> None:
    stand.feet.lift(side)
    assert stand.feel(side, 500.0, time_s=0.01) == 1
    assert stand.feel(side, 0.0, time_s=0.03) == 0
    assert stand.feet.states[side] is FootState.RELANDING
    assert not stand.contacts.in_contact[side]
    assert stand.feel(side, 100.0, time_s=0.01) == 0
    assert stand.feet.states[side] is FootState.LANDING


@SIDES
def test_a_bounce_waits_for_the_other_foot(stand: Stand, side: int) -> None:
    stand.feet.lift(side)
    stand.feel(side, 500.0, time_s=0.01)
    stand.feet.lift(1 - side)
    stand.feel(side, 0.0, time_s=0.1, may=False)
    assert stand.contacts.in_contact[side]


@SIDES
def test_load_grows_from_what_a_landing_foot_carries(stand: Stand, side: int) -> None:
    stand.feet.lift(side)
    stand.feel(side, 100.0, time_s=0.005)
    assert stand.contacts.allowed[side] < 0.1 * LARGEST_N
    stand.feel(side, 100.0, time_s=0.2)
    assert stand.contacts.allowed[side] == LARGEST_N


@SIDES
def test_a_foot_that_loses_its_ground_lands_again(stand: Stand, side: int) -> None:
    """The monitor alone would search for it as for ground that stands still."""
    stand.feel(side, FIRM_N, time_s=0.05)
    stand.feel(side, 0.0, time_s=0.05)
    assert stand.feet.states[side] is FootState.RELANDING
    assert not stand.contacts.in_contact[side]
    assert not stand.anchors.planted[side]
    assert stand.feel(side, 100.0, time_s=0.02) == 0
    assert stand.feet.states[side] is FootState.LANDING
    assert stand.contacts.in_contact[side]
