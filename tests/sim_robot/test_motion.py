from __future__ import annotations

import math

import pytest

from surefoot.schemas.arrays import GRAVITY_M_S2
from surefoot.schemas.motions import (
    BLEND_S,
    DropMotion,
    Motion,
    RampMotion,
    SineMotion,
)
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.motion import motion_law

START_S = 0.3
DERIVATIVE_STEP_S = 1e-6
DERIVATIVE_TOLERANCE = 1e-6
SAMPLES = 4000
LENGTH_S = 4.0

SINE = SineMotion(axis="z", amplitude_m=0.06, frequency_hz=0.9, start_s=START_S)
SHIFTED_SINE = SineMotion(
    axis="roll", amplitude_deg=8.6, frequency_hz=0.7, phase_deg=70.0, start_s=START_S
)
RAMP = RampMotion(axis="pitch", amplitude_deg=-15.0, rate_deg_s=40.0, start_s=START_S)
SHORT_RAMP = RampMotion(axis="x", amplitude_m=0.002, rate_m_s=1.0, start_s=START_S)
FREE_DROP = DropMotion(axis="z", amplitude_m=-0.08, start_s=START_S)
RATED_DROP = DropMotion(
    axis="roll", amplitude_deg=14.0, rate_deg_s=100.0, start_s=START_S
)
ALL = {
    "sine": SINE,
    "shifted sine": SHIFTED_SINE,
    "ramp": RAMP,
    "short ramp": SHORT_RAMP,
    "free drop": FREE_DROP,
    "rated drop": RATED_DROP,
}
each_motion = pytest.mark.parametrize("motion", ALL.values(), ids=ALL.keys())


@each_motion
def test_velocity_is_the_derivative_of_position(motion: Motion) -> None:
    law = motion_law(motion)
    for index in range(SAMPLES):
        # Off the corners, where the derivative of the position has a kink.
        time_s = (index + 0.137) * LENGTH_S / SAMPLES
        before, _ = law(time_s - DERIVATIVE_STEP_S)
        after, _ = law(time_s + DERIVATIVE_STEP_S)
        _, velocity = law(time_s)
        derivative = (after - before) / (2.0 * DERIVATIVE_STEP_S)
        assert velocity == pytest.approx(derivative, abs=DERIVATIVE_TOLERANCE)


@each_motion
def test_is_still_until_it_starts(motion: Motion) -> None:
    law = motion_law(motion)
    assert law(0.0) == (0.0, 0.0)
    assert law(START_S) == (0.0, 0.0)


@each_motion
def test_velocity_has_no_jump(motion: Motion) -> None:
    law = motion_law(motion)
    step_s = 1e-5
    largest = max(
        abs(law((i + 1) * step_s)[1] - law(i * step_s)[1])
        for i in range(int(2.0 / step_s))
    )
    # Steepest: braking from the fall or the rate over one blend, 1.5 x its mean.
    fastest = max(abs(law(i * 1e-3)[1]) for i in range(2000))
    assert largest <= 1.6 * fastest * step_s / BLEND_S


@pytest.mark.parametrize("motion", [RAMP, SHORT_RAMP, FREE_DROP, RATED_DROP])
def test_comes_to_rest_at_the_amplitude(motion: Motion) -> None:
    position, velocity = motion_law(motion)(START_S + 3.0)
    assert position == pytest.approx(motion.amplitude)
    assert velocity == 0.0


def test_ramp_cruises_at_its_rate() -> None:
    _, velocity = motion_law(RAMP)(START_S + 0.1)
    assert velocity == pytest.approx(-math.radians(40.0))


def test_free_drop_falls_with_gravity() -> None:
    fallen_s = 0.1
    position, velocity = motion_law(FREE_DROP)(START_S + fallen_s)
    assert position == pytest.approx(-0.5 * GRAVITY_M_S2 * fallen_s**2)
    assert velocity == pytest.approx(-GRAVITY_M_S2 * fallen_s)


def test_nothing_falls_upwards() -> None:
    motion = DropMotion(axis="z", amplitude_m=0.05)
    with pytest.raises(ScenarioError, match="rate_m_s to lift"):
        motion_law(motion)


def test_sine_reaches_its_amplitude_after_one_period() -> None:
    law = motion_law(SINE)
    crest_s = START_S + 1.25 / SINE.frequency_hz
    position, velocity = law(crest_s)
    assert position == pytest.approx(SINE.amplitude)
    assert velocity == pytest.approx(0.0, abs=1e-12)
    half_way, _ = law(START_S + 0.25 / SINE.frequency_hz)
    assert 0.0 < half_way < 0.2 * SINE.amplitude
