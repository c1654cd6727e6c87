"""The drives do what is wanted, within their speed limit."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.robot_file import ServoProfile
from surefoot.sim_robot.plant import Servos
from surefoot.stabilizer.control.drives import DriveInverse

PROFILE = ServoProfile(velocity_limit_rad_s=3.1, lag_s=0.02)
PERIOD_S = 0.001
JOINTS = 3
TICKS = 2000
MOST = np.full(JOINTS, 0.008)


def motion(*, rate: float, hz: float) -> Array:
    """Return swings that start and end at rest, (TICKS, JOINTS)."""
    t = PERIOD_S * np.arange(TICKS)[:, None]
    omega = 2.0 * np.pi * hz
    return rate / omega * (1.0 - np.cos(omega * t)) / (1.0 + np.arange(JOINTS))


def pair() -> tuple[DriveInverse, Servos]:
    inverse = DriveInverse(PROFILE, most=MOST, period_s=PERIOD_S)
    inverse.take_over(np.zeros(JOINTS))
    servos = Servos(PROFILE, posture=np.zeros(JOINTS), step_s=PERIOD_S)
    return inverse, servos


def test_real_drives_are_where_they_are_wanted_in_the_same_tick() -> None:
    inverse, servos = pair()
    for wanted in motion(rate=2.5, hz=1.5):
        asked = wanted.copy()
        setpoint = servos.step(inverse.follow(asked, share=1.0))
        assert asked == pytest.approx(wanted, abs=1e-12)
        assert setpoint == pytest.approx(wanted, abs=1e-12)


def test_what_speed_takes_away_is_given_back_and_known() -> None:
    inverse, servos = pair()
    beyond = 0
    asked = np.zeros(JOINTS)
    for wanted in np.diff(motion(rate=6.0, hz=1.5), axis=0):
        before = inverse.sent.copy()
        asked += wanted
        setpoint = servos.step(inverse.follow(asked, share=1.0))
        assert np.abs(inverse.sent - before).max() <= 3.1 * PERIOD_S + 1e-12
        assert inverse.reached == pytest.approx(setpoint, abs=1e-12)
        assert asked == pytest.approx(setpoint, abs=1e-12)
        beyond += int(np.abs(inverse.sent - before).max() > 3.0999 * PERIOD_S)
    assert beyond > 100


def test_drives_go_on_in_a_tick_without_a_command() -> None:
    inverse, servos = pair()
    asked = np.zeros(JOINTS)
    slow = 0.1 * motion(rate=2.5, hz=1.5)
    for tick, wanted in enumerate(slow):
        if tick % 5 in (2, 3):
            inverse.wait()
            setpoint = servos.step(inverse.sent)
        else:
            asked[:] = wanted
            setpoint = servos.step(inverse.follow(asked, share=1.0))
        assert inverse.reached == pytest.approx(setpoint, abs=1e-12)


def test_what_missed_ticks_could_not_move_comes_with_the_next_command() -> None:
    inverse, _ = pair()
    far = np.ones(JOINTS)
    inverse.wait()
    assert inverse.follow(far.copy(), share=1.0) == pytest.approx(2 * 3.1 * PERIOD_S)
    inverse.take_over(np.zeros(JOINTS))
    for _ in range(9):
        inverse.wait()
    assert inverse.follow(far.copy(), share=1.0) == pytest.approx(MOST)
    before = inverse.sent.copy()
    assert inverse.follow(far.copy(), share=1.0) - before == pytest.approx(
        3.1 * PERIOD_S
    )


def test_without_a_share_what_is_wanted_is_sent_and_kept() -> None:
    inverse, _ = pair()
    for wanted in motion(rate=2.5, hz=1.5):
        asked = wanted.copy()
        assert np.array_equal(inverse.follow(asked, share=0.0), wanted)
        assert np.array_equal(asked, wanted)


def test_drives_without_lag_need_no_inverse() -> None:
    prompt = ServoProfile(velocity_limit_rad_s=12.0, lag_s=0.0)
    assert not DriveInverse(prompt, most=MOST, period_s=PERIOD_S).lags
