"""Gyroscope and attitude of one unit are compared, whatever way it turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Mat, Vec3
from surefoot.schemas.settings import SafetySettings
from surefoot.stabilizer.safety.consistency import TurnCheck
from tests.robot_io.sensor_messages import snapshot_at

DT = 1e-3
SECONDS = 3.0
FAILS_S = 1.0
UPDATES = {"every tick": 1, "50 Hz": 20}
"""Ticks from one attitude of the unit to the next."""


def rate_at(time_s: float) -> Vec3:
    """Return a rate of turn of up to 2 rad/s [rad/s]."""
    return np.array(
        [
            1.2 * np.sin(4.0 * time_s),
            -1.5 * np.cos(3.0 * time_s) + 0.4,
            0.9 * np.sin(time_s),
        ]
    )


def reading(R_world_imu: Mat, gyro: Vec3) -> Snapshot:
    quat = pin.Quaternion(R_world_imu).coeffs()
    return replace(snapshot_at(0), quat_xyzw=quat, angular_velocity=gyro)


class Turning:
    """A unit that turns, checked tick by tick."""

    def __init__(self, *, turns: float = 1.0, attitude_ticks: int = 1) -> None:
        self.check = TurnCheck(SafetySettings(), period_s=DT)
        self.R_world_imu: Mat = pin.exp3(np.array([0.3, -0.2, 0.5]))
        self.R_told = self.R_world_imu
        self.tick = 0
        self._turns, self._attitude_ticks = turns, attitude_ticks

    def advance(self, **wrong: object) -> bool:
        """Advance by one tick; return whether the readings are called apart."""
        rate = self._turns * rate_at((self.tick + 0.5) * DT)
        self.R_world_imu = self.R_world_imu @ pin.exp3(rate * DT)
        self.tick += 1
        if self.tick % self._attitude_ticks == 0:
            self.R_told = self.R_world_imu
        self.check.update(replace(reading(self.R_told, rate), **wrong))
        return self.check.are_apart

    @property
    def time_s(self) -> float:
        return self.tick * DT

    @property
    def gyro(self) -> Vec3:
        return self._turns * rate_at((self.tick + 0.5) * DT)


@pytest.mark.parametrize("ticks", UPDATES.values(), ids=UPDATES)
def test_a_unit_that_turns_agrees_with_itself(ticks: int) -> None:
    unit = Turning(attitude_ticks=ticks)
    assert not any(unit.advance() for _ in range(round(SECONDS / DT)))


@pytest.mark.parametrize("ticks", UPDATES.values(), ids=UPDATES)
def test_a_gyroscope_that_stands_still_is_told(ticks: int) -> None:
    unit = Turning(turns=0.3, attitude_ticks=ticks)
    while unit.time_s < FAILS_S:
        assert not unit.advance()
    stuck = unit.gyro
    assert any(unit.advance(angular_velocity=stuck) for _ in range(1500))


def test_a_gyroscope_that_drifts_at_rest_is_told() -> None:
    unit = Turning(turns=1e-6)
    while not unit.advance(angular_velocity=np.array([0.1 * unit.time_s, 0.0, 0.0])):
        assert unit.time_s < 2.0
    assert unit.time_s > 0.5


def test_a_bias_from_the_start_is_none_of_its_business() -> None:
    unit = Turning(turns=0.2)
    bias = np.array([0.05, -0.08, 0.02])
    assert not any(
        unit.advance(angular_velocity=unit.gyro + bias)
        for _ in range(round(SECONDS / DT))
    )


def test_an_attitude_that_never_changes_tells_nothing() -> None:
    unit = Turning(attitude_ticks=10**9)
    assert not any(unit.advance() for _ in range(round(SECONDS / DT)))


def test_a_heading_that_is_corrected_tells_nothing() -> None:
    unit = Turning(turns=0.5)
    for _ in range(round(SECONDS / DT)):
        heading = pin.exp3(np.array([0.0, 0.0, 0.5 * (unit.tick % 700 == 0)]))
        unit.R_world_imu = heading @ unit.R_world_imu
        assert not unit.advance()


def test_a_wrong_attitude_for_a_moment_is_overlooked() -> None:
    unit = Turning(turns=0.5)
    while unit.time_s < FAILS_S:
        unit.advance()
    odd = pin.Quaternion(pin.exp3(np.array([0.0, 0.7, 0.0]))).coeffs()
    assert not any(unit.advance(quat_xyzw=odd) for _ in range(8))
    assert not any(unit.advance() for _ in range(500))
