"""K follows delay, rate, contact stiffness and the age of the readings."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.sensors import SENSORS
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.control.drives import borne_delay, needed_stiffness
from surefoot.stabilizer.estimation.observer import FORCES, MOTION, ReadingAges
from surefoot.stabilizer.margins.margins import compute_margins
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.support import with_rate

SPEED = 470.0
PERIOD_S = 0.001
NS = 1_000_000
ALMOST_DB = 5.9


def stiffness(robot: Robot, *overrides: str) -> float:
    settings = build_settings({}, overrides=list(overrides))
    return WholeBodyController(robot, settings).law.stiffness


def test_the_walker_keeps_its_gains_with_ideal_drives_at_one_tick(
    walker: Robot,
) -> None:
    assert stiffness(walker) == 1.0


def test_twice_the_speed_or_the_period_needs_twice_the_stiffness() -> None:
    one = needed_stiffness(2.0 * SPEED, delay_ticks=2, period_s=PERIOD_S)
    two = needed_stiffness(4.0 * SPEED, delay_ticks=2, period_s=PERIOD_S)
    three = needed_stiffness(2.0 * SPEED, delay_ticks=2, period_s=2.0 * PERIOD_S)
    assert two == pytest.approx(2.0 * one)
    assert three == pytest.approx(2.0 * one)


def test_long_delays_need_stiffness_in_proportion() -> None:
    one, two = (
        needed_stiffness(SPEED, delay_ticks=d, period_s=PERIOD_S) for d in (50, 100)
    )
    assert two / one == pytest.approx(2.0, rel=0.01)


def test_soft_soles_yield_by_themselves(walker: Robot) -> None:
    late = "dik.loop_delay_s=0.006"
    hard, soft = (
        stiffness(walker, late),
        stiffness(walker, late, "contact.stiffness_n_m=2e5"),
    )
    assert 1.0 < soft < hard


@pytest.mark.parametrize(("rate_hz", "ticks"), [(200.0, 1), (1000.0, 4)])
def test_the_rule_leaves_the_whole_loop_its_margin(
    walker: Robot, rate_hz: float, ticks: int
) -> None:
    robot = with_rate(walker, rate_hz)
    settings = build_settings({}, overrides=[f"dik.loop_delay_s={ticks / rate_hz}"])
    worst = compute_margins(robot, settings, delay_ticks=ticks).worst_db
    assert worst is not None
    assert worst > ALMOST_DB


def test_what_is_borne_is_what_the_whole_loop_bears(walker: Robot) -> None:
    default = build_settings({}, overrides=[])
    assert borne_delay(walker, default) == 3
    told = build_settings({}, overrides=["dik.loop_delay_s=0.006"])
    assert borne_delay(walker, told) > 10


def snapshot(tick: int, *, forces_late: int, motion_late: int) -> Snapshot:
    now = 1_000_000_000 + tick * NS
    late = {
        **dict.fromkeys(FORCES, forces_late),
        **dict.fromkeys(MOTION, motion_late),
    }
    measured = tuple(now - NS * late[index] for index in range(len(SENSORS)))
    zeros = np.zeros(3)
    return Snapshot(
        tick, now, *[zeros] * (len(Snapshot.__slots__) - 3), measured_ns=measured
    )


def test_an_older_force_reading_counts_at_once_and_for_a_second() -> None:
    ages = ReadingAges(period_s=PERIOD_S)
    assert ages.add(snapshot(0, forces_late=9, motion_late=0))
    assert ages.forces_s == pytest.approx(0.009)
    for tick in range(1, 900):
        ages.add(snapshot(tick, forces_late=tick % 3, motion_late=0))
        assert ages.forces_s == pytest.approx(0.009)
    for tick in range(900, 1500):
        ages.add(snapshot(tick, forces_late=tick % 3, motion_late=0))
    assert ages.forces_s == pytest.approx(0.002)


def test_what_tells_motion_counts_by_its_mean() -> None:
    ages = ReadingAges(period_s=PERIOD_S)
    for tick in range(200):
        ages.add(snapshot(tick, forces_late=0, motion_late=tick % 10))
    assert ages.motion_s == pytest.approx(0.0045)
