"""Soft ground is distinguished from moving ground."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.stabilizer.control.soft_ground import (
    FIRM_M_N,
    SOFTEST_M_N,
    SoftGround,
)

HALF_LENGTH, HALF_WIDTH, DT = 0.13, 0.08, 1e-3
FORCE_N, SWING_N, TURN_N_M = 400.0, 150.0, 12.0
BOTH, LEFT_LANDS = (True, True), (False, True)


def stand(
    soft: SoftGround,
    compliance: float,
    *,
    moves: float = 0.0,
    held_by: float = 0.0,
    seconds: float = 2.0,
    hz: float = 3.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the ground's rate under soles whose forces and moments swing.

    Args:
        soft: judges the ground.
        compliance: compliance of the ground [m/N].
        moves: largest velocity and turning rate of the ground, at 0.6 Hz [m/s, rad/s].
        held_by: change of the wrench per velocity of the ground, since a robot resists
            it [N s/m].
        seconds: duration [s].
        hz: frequency of the force; moments swing 1.3 times as fast.

    Returns:
        Estimated and true roll rate of the ground under the left sole in the second
        half, each (n,) [rad/s].
    """
    noise = np.random.default_rng(3)
    times = np.arange(round(seconds / DT)) * DT
    w, slow = 2.0 * np.pi * hz, 2.0 * np.pi * 0.6
    ground = moves * np.cos(slow * times)
    force = FORCE_N + SWING_N * np.sin(w * times) + held_by * ground
    moment = TURN_N_M * np.sin(1.3 * w * times) + held_by * HALF_WIDTH**2 * ground
    force_rate, moment_rate = np.gradient(force, DT), np.gradient(moment, DT)
    turned = ground - compliance * moment_rate / HALF_WIDTH**2
    told = []
    for k in range(len(times)):
        F = np.array([0.0, 0.0, force[k], moment[k], 0.0, 0.0])
        F += noise.normal(0.0, (2.0, 2.0, 2.0, 0.1, 0.1, 0.1))
        sunk = compliance * force_rate[k]
        v = np.array([0.0, 0.0, ground[k] - sunk, turned[k], 0.0, 0.0])
        v += noise.normal(0.0, 2e-3, 6)
        soft.update(np.tile(v, 2), np.tile(F, 2), BOTH)
        told.append(v[3] + soft.given[3])
    half = len(times) // 2
    return np.array(told[half:]), ground[half:]


@pytest.fixture
def soft() -> SoftGround:
    return SoftGround(half_sizes=[(HALF_LENGTH, HALF_WIDTH)] * 2, period_s=DT)


@pytest.mark.parametrize("stiffness", [40e3, 160e3, 600e3])
@pytest.mark.parametrize("moves", [0.0, 0.2])
def test_ground_that_gives_way_is_taken_off(
    soft: SoftGround, stiffness: float, moves: float
) -> None:
    told, true = stand(soft, 1.0 / stiffness, moves=moves)
    for side in range(2):
        assert soft.compliance[side] == pytest.approx(1.0 / stiffness, rel=0.35)
        assert 0.0 < soft.sinking[side] <= soft.compliance[side]
    turns = TURN_N_M * 2.6 * np.pi * 3.0 / stiffness / HALF_WIDTH**2
    assert np.std(told - true) < 0.6 * turns / np.sqrt(2.0) + 2.5e-3


@pytest.mark.parametrize("held_by", [0.0, 500.0])
@pytest.mark.parametrize("hz", [0.9, 2.0])
def test_firm_ground_that_moves_is_none(
    soft: SoftGround, held_by: float, hz: float
) -> None:
    told, true = stand(soft, 0.0, moves=0.5, held_by=held_by, seconds=5.0, hz=hz)
    assert max(soft.compliance) < FIRM_M_N
    assert np.std(told - true) < 2.5e-3


def test_a_blow_is_no_evidence(soft: SoftGround) -> None:
    """A sole that slaps down on firm ground, within 20 ms, looks as soft as a bed."""
    for k in range(20):
        F = np.tile([0.0, 0.0, 300.0, 1.0 * k, 0.0, 0.0], 2)
        v = np.tile([0.0, 0.0, 0.0, -1.0, 0.0, 0.0], 2)
        soft.update(v, F, BOTH)
    assert soft.compliance[0] < 0.2 * SOFTEST_M_N


def test_a_foot_expects_what_the_other_one_stands_on(soft: SoftGround) -> None:
    stiffness = 100e3
    stand(soft, 1.0 / stiffness)
    soft._turns[0][1] = 0.0
    F = np.tile([0.0, 0.0, FORCE_N, 0.0, 0.0, 0.0], 2)
    soft.update(np.zeros(12), F, LEFT_LANDS)
    np.testing.assert_array_equal(soft.given[:6], 0.0)
    soft.update(np.zeros(12), F, BOTH)
    assert soft.compliance[0] == pytest.approx(1.0 / stiffness, rel=0.5)
