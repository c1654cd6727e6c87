from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.motions import PrtsMotion
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.motion import motion_law, prts_states

SPEED = 4.0
CYCLE_S = 20.0 / SPEED
STEP_S = 1e-3
PITCH = PrtsMotion(axis="pitch", peak_to_peak_deg=8.0, speed=SPEED, cycles=2)
ABRUPT = replace(PITCH, blend_s=0.002)
"""Blends so short that they hardly count."""


def _sampled(motion: PrtsMotion, cycle: int) -> tuple[np.ndarray, np.ndarray]:
    law = motion_law(motion)
    times = CYCLE_S * cycle + STEP_S * np.arange(round(CYCLE_S / STEP_S))
    position, velocity = np.array([law(float(t)) for t in times]).T
    return position, velocity


def test_register_runs_through_all_states_and_begins_again() -> None:
    states = prts_states()
    assert len(states) == 80
    assert [states.count(state) for state in (-1, 0, 1)] == [27, 26, 27]
    windows = {tuple((states * 2)[i : i + 4]) for i in range(80)}
    assert len(windows) == 80  # every register but 0 0 0 0, once
    assert states[40:] == [-state for state in states[:40]]


def test_spans_what_was_asked_for_and_ends_where_it_began() -> None:
    position, _ = _sampled(ABRUPT, 1)
    assert np.ptp(position) == pytest.approx(math.radians(8.0), rel=2e-3)
    rounded, _ = _sampled(PITCH, 1)
    assert np.ptp(rounded) == pytest.approx(math.radians(8.0), rel=2e-2)
    assert motion_law(PITCH)(2 * CYCLE_S + 1.0) == (pytest.approx(0.0, abs=1e-12), 0.0)


def test_a_translation_is_the_same_sequence_in_metres() -> None:
    along = PrtsMotion(axis="x", peak_to_peak_m=0.08, speed=SPEED, cycles=2)
    for time_s in (0.3, 1.0, 4.2):
        tilt, metres = motion_law(PITCH)(time_s), motion_law(along)(time_s)
        assert metres[0] / 0.08 == pytest.approx(tilt[0] / math.radians(8.0))


def test_power_lies_at_odd_harmonics_and_is_that_of_the_sequence() -> None:
    _, velocity = _sampled(ABRUPT, 1)
    power = 2.0 * np.abs(np.fft.rfft(velocity) / len(velocity)) ** 2
    assert power[0:160:2].max() < 1e-6 * power[1:160:2].max()
    # That of the states, each held, at the protocol's frequencies and far beyond.
    held = np.repeat(prts_states(), round(PITCH.state_s / STEP_S)) * PITCH.rate
    expected = 2.0 * np.abs(np.fft.rfft(held) / len(held)) ** 2
    assert power[1:80:2] == pytest.approx(expected[1:80:2], rel=0.01)


def test_rate_is_the_span_over_nine_states() -> None:
    _, velocity = _sampled(PITCH, 1)
    assert velocity.max() == pytest.approx(math.radians(8.0) / 2.25 * SPEED)


def test_too_fast_a_sequence_is_refused() -> None:
    motion = PrtsMotion(axis="x", peak_to_peak_m=0.01, speed=400.0, blend_s=1e-4)
    with pytest.raises(ScenarioError, match="blend_s"):
        motion_law(motion)
    course = {"kind": "prts", "axis": "x", "peak_to_peak_m": 0.1, "speed": 20.0}
    platform = {"foot": "both", "motion": [course]}
    raw = {"name": "fast", "duration_s": 1.0, "platform": [platform]}
    with pytest.raises(FileFormatError, match=r"lasts 0\.0125 s"):
        scenario_from_table(raw, source="here")
