"""Searches for margins, impedances and proportions, on known systems."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surefoot.bench.bench_runs import PERSON, Subject, Under, proportion
from surefoot.bench.push_cells import (
    KINDS,
    MOST_STEPS,
    SINES,
    START_S,
    WITHIN,
    Disturbance,
    MarginSearch,
    PushKind,
    first_guess,
    fit_impedance,
    push_cell,
)
from surefoot.bench.push_results import PushResult, write_push_page
from surefoot.bench.sway_response import phasor

EXACT = 1e-9
ROUNDED = 1e-3
TWICE = Subject(
    mass_kg=8.0 * PERSON.mass_kg,
    com_height_m=2.0 * PERSON.com_height_m,
    base_depth_m=2.0 * PERSON.base_depth_m,
    base_width_m=2.0 * PERSON.base_width_m,
)
"""A person twice as tall."""


def search_for(limit: float, *, guess: float) -> MarginSearch:
    search = MarginSearch(guess)
    while not search.is_done:
        search.tell(stood=search.size <= limit)
    return search


@pytest.mark.parametrize("guess", [1.0, 0.03, 40.0])
def test_a_margin_is_found_within_two_per_cent_wherever_it_is_sought(
    guess: float,
) -> None:
    rng = np.random.default_rng(0)
    for limit in guess * 2.0 ** rng.uniform(-5.0, 5.0, 100):
        search = search_for(limit, guess=guess)
        assert search.fell is not None
        assert search.stood <= limit < search.fell
        assert search.fell <= WITHIN * search.stood * (1.0 + ROUNDED)
        assert search.tried <= MOST_STEPS + 8


def test_who_stands_everything_has_no_upper_end_who_always_falls_no_margin() -> None:
    steady, weak = search_for(np.inf, guess=2.0), search_for(-1.0, guess=2.0)
    assert steady.fell is None
    assert steady.stood == pytest.approx(2.0 * 2.0**MOST_STEPS)
    assert weak.stood == 0.0
    assert steady.tried == weak.tried == MOST_STEPS + 1


def test_mass_damper_and_spring_are_found_again() -> None:
    frequencies = [0.5, 1.0, 2.0, 4.0]
    omega = 2.0 * np.pi * np.array(frequencies)
    answers = 4000.0 - 30.0 * omega**2 + 1j * omega * 250.0
    found = fit_impedance(frequencies, answers.tolist())
    assert found == pytest.approx((30.0, 250.0, 4000.0))


def test_one_frequency_cannot_tell_a_spring_from_a_mass() -> None:
    assert fit_impedance([1.0, 1.0], [10.0 + 1.0j, 11.0 + 2.0j]) is None


def test_a_phasor_is_amplitude_and_phase_and_blind_to_what_does_not_swing() -> None:
    period_s, frequency_hz = 0.002, 2.5
    angle = 2.0 * np.pi * frequency_hz * period_s * np.arange(600)
    values = 3.0 * np.cos(angle + 0.4) + 5.0 - 0.01 * np.arange(600)
    found = phasor(values, period_s=period_s, frequency_hz=frequency_hz)
    assert found == pytest.approx(3.0 * np.exp(0.4j), abs=EXACT)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("frequency_hz", [0.5, 2.0, 4.0])
def test_a_push_lasts_until_what_was_too_much_has_fallen(
    kind: PushKind, frequency_hz: float
) -> None:
    who = Under("whole-body", "ideal")
    disturbance = Disturbance(kind, 0.0, frequency_hz if kind in SINES else 0.0)
    cell = push_cell(disturbance, 1.0, who, subject=PERSON, body="pelvis")
    fall_s = (PERSON.com_height_m / 9.81) ** 0.5
    assert cell.scenario.duration_s - START_S > 10.0 * fall_s


def test_a_page_has_those_sines_alone_that_were_stood(tmp_path: Path) -> None:
    def result(kind: PushKind, at_hz: float, stood: float) -> PushResult:
        disturbance = Disturbance(kind, 0.0, at_hz)
        who = Under("hold", "ideal")
        return PushResult(disturbance, who, PERSON, stood, 2.0 * stood + 1.0, 7, None)

    none = [result("sine-displacement", at_hz, 0.0) for at_hz in (1.0, 2.0)]
    some = [result("sine-force", at_hz, 10.0 * at_hz) for at_hz in (1.0, 2.0)]
    for results, drawings in ((none, 0), ([*none, *some], 1), (some, 1)):
        write_push_page(tmp_path, results, robot="walker", subject=PERSON)
        page = (tmp_path / "index.html").read_text()
        assert page.count("margins of sines") == drawings


def test_a_person_is_in_proportion_to_a_person() -> None:
    for direction in (0.0, 90.0):
        of = proportion(PERSON, direction_deg=direction)
        assert (of.force, of.energy, of.way) == pytest.approx((1.0, 1.0, 1.0))


def test_proportions_scale_as_weight_energy_and_length_do() -> None:
    of = proportion(TWICE, direction_deg=0.0)
    assert (of.force, of.energy, of.way) == pytest.approx((8.0, 16.0, 2.0))


@pytest.mark.parametrize("kind", KINDS)
def test_guesses_keep_their_proportion(kind: str) -> None:
    """A body twice as tall tips by the same figure, as it would be for a person."""
    disturbance = Disturbance(kind, 0.0)  # type: ignore[arg-type]
    ours, theirs = (first_guess(disturbance, who) for who in (TWICE, PERSON))
    of = proportion(TWICE, direction_deg=0.0)
    scale = {"N": of.force, "m": of.way, "m/s": of.way**0.5}
    unit = "m/s" if kind == "impulse" else "m" if "displacement" in kind else "N"
    assert ours / theirs == pytest.approx(scale[unit])


def test_the_nearer_edge_is_where_a_body_tips() -> None:
    assert PERSON.base_m(0.0) == pytest.approx(PERSON.base_depth_m)
    assert PERSON.base_m(270.0) == pytest.approx(PERSON.base_width_m)
    assert PERSON.base_m(45.0) == pytest.approx(2.0**0.5 * PERSON.base_depth_m)
