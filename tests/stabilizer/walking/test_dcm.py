"""The closed form obeys the DCM's law, and ends where it should."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from surefoot.stabilizer.walking.dcm import (
    ZmpPhase,
    dcm_at_begin,
    dcm_now,
    shift_between,
)

OMEGA = 3.83
DT = 1e-4
SLOPE_TOLERANCE = 1e-5
EXACT = 1e-9


def some_phases(rng: np.random.Generator, *, count: int) -> list[ZmpPhase]:
    """Return consecutive phases, each beginning where the last one ends."""
    points = [tuple(point) for point in rng.normal(size=(count + 1, 2))]
    durations = rng.uniform(0.1, 1.0, size=count)
    return [
        ZmpPhase(duration, begin, end)
        for duration, (begin, end) in zip(
            durations, itertools.pairwise(points), strict=True
        )
    ]


def rest_of(phase: ZmpPhase, done_s: float) -> ZmpPhase:
    share = done_s / phase.duration_s
    here = tuple(
        a + share * (b - a) for a, b in zip(phase.begin, phase.end, strict=True)
    )
    return ZmpPhase(phase.duration_s - done_s, here, phase.end)


@pytest.mark.parametrize("seed", range(5))
def test_dcm_moves_away_from_the_zmp_at_omega(seed: int) -> None:
    rng = np.random.default_rng(seed)
    (phase,) = some_phases(rng, count=1)
    xi_end = tuple(rng.normal(size=2))
    middle = 0.5 * phase.duration_s
    before, now, after = (
        np.array(dcm_at_begin(rest_of(phase, middle + step), xi_end, OMEGA))
        for step in (-DT, 0.0, DT)
    )
    zmp = np.array(rest_of(phase, middle).begin)
    slope = (after - before) / (2.0 * DT)
    np.testing.assert_allclose(slope, OMEGA * (now - zmp), rtol=SLOPE_TOLERANCE)


def test_a_chain_is_one_phase_after_the_other_backwards() -> None:
    rng = np.random.default_rng(3)
    phases = some_phases(rng, count=4)
    xi = xi_end = tuple(rng.normal(size=2))
    for phase in reversed(phases):
        xi = dcm_at_begin(phase, xi, OMEGA)
    assert dcm_now(phases, xi_end, OMEGA) == xi
    assert dcm_now([], xi_end, OMEGA) == xi_end


def test_a_phase_that_is_over_changes_nothing() -> None:
    over = ZmpPhase(0.0, (0.3, 0.1), (0.4, 0.2))
    assert dcm_at_begin(over, (1.0, 2.0), OMEGA) == (1.0, 2.0)


def test_what_is_far_ahead_hardly_matters_now() -> None:
    phases = [ZmpPhase(1.0, (0.0, 0.0), (0.0, 0.0))] * 3
    near, far = (dcm_now(phases, (x, 0.0), OMEGA)[0] for x in (0.0, 1.0))
    assert far - near == pytest.approx(np.exp(-3.0 * OMEGA))


@pytest.mark.parametrize("duration_s", [0.4, 0.8, 1.5])
def test_a_shift_begins_where_the_dcm_is(duration_s: float) -> None:
    rng = np.random.default_rng(7)
    xi_begin, begin, end, xi_end = (tuple(p) for p in 0.1 * rng.normal(size=(4, 2)))
    halfway = shift_between(
        xi_begin, begin, end, xi_end, duration_s=duration_s, omega=OMEGA
    )
    halves = [
        ZmpPhase(0.5 * duration_s, begin, halfway),
        ZmpPhase(0.5 * duration_s, halfway, end),
    ]
    assert dcm_now(halves, xi_end, OMEGA) == pytest.approx(xi_begin, abs=EXACT)


def test_the_zmp_of_a_shift_goes_the_other_way_first() -> None:
    _, y = shift_between(
        (0.0, 0.0), (0.0, 0.0), (0.0, 0.11), (0.0, 0.09), duration_s=0.8, omega=OMEGA
    )
    assert y < 0.0
