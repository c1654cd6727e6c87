"""The height filter alone, on ground of any height."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.estimation.ground_swing import GroundSwing, Pace
from surefoot.stabilizer.estimation.height import HeightFilter

PERIOD_S, STEP_S = 0.002, 1e-3
STROKE = (-0.08, 0.15)
STANDS_M = 0.8
"""Height of the point above the ground, which the robot keeps [m]."""
Ground = Callable[[float], float]


def ramp(time_s: float, *, lift: float, speed: float = 0.3) -> float:
    """Return ground that rises or sinks from the first second on, and then stays."""
    end_s = abs(lift) / speed
    x = min(max((time_s - 1.0) / end_s, 0.0), 1.0)
    return lift * x * x * (3.0 - 2.0 * x)


def follow(
    ground: Ground,
    *,
    duration_s: float,
    bias: float = 0.0,
    drift: float = 0.0,
    by_feet: Ground = lambda _: 0.0,
    moves: bool = False,
    steps: bool = False,
    stroke: tuple[float, float] = STROKE,
) -> tuple[Array, Array]:
    """Return true and estimated height of the ground, a row per tick.

    ``by_feet`` is an acceleration that only the feet's forces show.
    """
    height = HeightFilter(EstimatorSettings(), stroke=stroke, period_s=PERIOD_S)
    rows = []
    for time_s in PERIOD_S * np.arange(round(duration_s / PERIOD_S)):
        before, now, after = (ground(time_s + d) for d in (-STEP_S, 0.0, STEP_S))
        off = bias + drift * time_s
        acceleration = off + (after - 2.0 * now + before) / STEP_S**2
        difference = off - by_feet(time_s)
        if time_s < 0.3:
            height.calibrate(
                acceleration, difference, height=STANDS_M, rate=0.0, moves=moves
            )
        else:
            height.update(
                acceleration, difference, over=STANDS_M, rate=0.0, steps=steps
            )
        rows.append((now, height.ground))
    truth, estimate = np.array(rows).T
    return truth, estimate


@pytest.mark.parametrize("lift", [0.6, -0.5])
def test_ground_beyond_the_stroke_takes_the_level_along(lift: float) -> None:
    _, estimate = follow(lambda t: ramp(t, lift=lift), duration_s=14.0)
    lowest, highest = STROKE
    end = highest if lift > 0.0 else lowest
    assert np.isclose(estimate, end).any()
    back = estimate[-1]
    assert abs(back) < 0.01
    assert np.min(estimate * np.sign(lift)) > -0.35 * abs(end)


def test_legs_without_a_stroke_go_along_with_all_ground() -> None:
    ground = partial(ramp, lift=0.1)
    _, estimate = follow(ground, duration_s=2.0, stroke=(0.0, 0.0))
    np.testing.assert_array_equal(estimate, 0.0)


def test_after_a_slow_lift_the_stroke_s_end_is_left_soon() -> None:
    """The rate that a slow lift leaves behind leads there, but must not stay there."""
    lift, speed = 0.45, 0.08
    _, estimate = follow(lambda t: ramp(t, lift=lift, speed=speed), duration_s=11.2)
    lowest, _ = STROKE
    assert np.isclose(estimate, lowest).any()
    assert abs(estimate[-1]) < 0.02


@pytest.mark.parametrize("period_s", [6.0, 12.0])
def test_ground_that_swings_beyond_the_stroke_is_ridden(period_s: float) -> None:
    """A deck in a swell: held in the world, the robot was at its legs' end for good."""

    def swell(time_s: float) -> float:
        moved = max(time_s - 1.0, 0.0)
        return float(np.tanh(moved) * np.sin(2.0 * np.pi * moved / period_s))

    _, estimate = follow(swell, duration_s=40.0)
    assert np.abs(estimate[round(10.0 / PERIOD_S) :]).max() < 0.03


def test_who_has_ridden_keeps_its_height_again_on_ground_that_calms_down() -> None:
    def calming(time_s: float) -> float:
        swing = 0.5 if time_s < 21.0 else 0.05
        return swing * np.sin(np.pi * max(time_s - 1.0, 0.0))

    truth, estimate = follow(calming, duration_s=90.0)
    last = slice(round(80.0 / PERIOD_S), None)
    np.testing.assert_allclose(estimate[last], truth[last], atol=0.015)


def begins_to_heave(time_s: float) -> float:
    moved = max(time_s - 1.0, 0.0)
    return float(0.05 * np.tanh(moved**3) * np.sin(3.0 * moved))


@pytest.mark.parametrize("bias", [0.3, -0.2, 0.03, 0.01, -0.006])
def test_a_bias_calibrated_at_rest_leaves_the_height_alone(bias: float) -> None:
    _, plain = follow(begins_to_heave, duration_s=8.0)
    _, biased = follow(begins_to_heave, duration_s=8.0, bias=bias)
    np.testing.assert_allclose(biased, plain, atol=3e-3)


@pytest.mark.parametrize(
    ("bias", "load"), [(0.3, 0.45), (0.3, 0.2), (-0.2, -0.3), (0.1, 0.3)]
)
def test_a_load_does_not_hide_a_bias(bias: float, load: float) -> None:
    """The feet are off by as much as it weighs, to either side of the bias."""
    _, plain = follow(begins_to_heave, duration_s=8.0)
    _, biased = follow(
        begins_to_heave, duration_s=8.0, bias=bias, by_feet=lambda _: load
    )
    np.testing.assert_allclose(biased, plain, atol=3e-3)


@pytest.mark.parametrize("bias", [0.22, -0.25, 0.12])
def test_feet_that_are_off_as_the_accelerometer_is_do_not_make_it_the_ground(
    bias: float,
) -> None:
    """By chance, as a load may have it; taken for the ground it cost up to 195 mm."""
    truth, estimate = follow(
        begins_to_heave, duration_s=8.0, bias=bias, by_feet=lambda _: bias
    )
    assert np.abs(estimate - truth).max() < 0.055


@pytest.mark.parametrize(
    ("bias", "pause_s"), [(0.01, 0.02), (-0.008, 0.2), (0.005, 0.4)]
)
def test_a_small_bias_counts_on_ground_that_begins_to_move_at_once(
    bias: float, pause_s: float
) -> None:
    """Feet that do not share it tell it from ground; dropped, it cost up to 65 mm."""

    def ground(time_s: float) -> float:
        return swinging(time_s + 0.7 - pause_s, frequency_hz=0.96)

    _, plain = follow(ground, duration_s=8.0)
    _, biased = follow(ground, duration_s=8.0, bias=bias)
    np.testing.assert_allclose(biased, plain, atol=5e-3)


@pytest.mark.parametrize("frequency_hz", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("phase", np.arange(0.0, 2.0 * np.pi, np.pi / 6.0))
def test_ground_that_begins_to_heave_while_it_is_calibrated_is_no_bias(
    phase: float, frequency_hz: float
) -> None:
    """So gently, as platforms do, that no reading tells; up to 145 mm rms were lost."""

    def heave(time_s: float) -> float:
        x = min(max(time_s, 0.0), 1.0)
        gently = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        turned = 2.0 * np.pi * frequency_hz * time_s + phase
        return float(0.05 * gently * np.sin(turned))

    truth, estimate = follow(heave, duration_s=6.0)
    later = slice(round(1.0 / PERIOD_S), None)
    assert np.sqrt(np.mean((estimate - truth)[later] ** 2)) < 0.036


@pytest.mark.parametrize("phase_deg", [30, 60, 90, 210, 240, 270])
@pytest.mark.parametrize("amplitude_m", [0.03, 0.06])
def test_ground_that_speeds_up_evenly_at_the_start_is_not_gravity_s(
    phase_deg: int, amplitude_m: float
) -> None:
    """Feet and accelerometer share it; believed for good, it cost up to 155 mm."""

    def heave(time_s: float) -> float:
        x = min(0.5 * time_s, 1.0)
        gently = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        turned = np.pi * time_s + np.radians(phase_deg)
        return float(amplitude_m * gently * np.sin(turned))

    truth, estimate = follow(heave, duration_s=8.0)
    assert np.abs(estimate - truth).max() < amplitude_m


@pytest.mark.parametrize("off", [0.1, -0.1])
def test_what_the_feet_tell_better_by_and_by_is_no_drift(off: float) -> None:
    """In the first readings they still settle; a third of a second is not much."""
    _, plain = follow(begins_to_heave, duration_s=8.0, bias=0.1)
    _, settling = follow(
        begins_to_heave,
        duration_s=8.0,
        bias=0.1,
        by_feet=lambda time_s: off if time_s < 0.1 else 0.0,
    )
    np.testing.assert_allclose(settling, plain, atol=0.055)


def test_a_load_picked_up_is_no_acceleration() -> None:
    _, estimate = follow(
        lambda _: 0.0, duration_s=6.0, by_feet=lambda time_s: 0.4 * (time_s > 3.0)
    )
    assert np.abs(estimate).max() < 0.03


@pytest.mark.parametrize("pace_hz", [8.0, 14.0, 25.0])
@pytest.mark.parametrize("size", [0.1, 1.0, 5.0])
def test_feet_that_bounce_leave_the_height_alone(pace_hz: float, size: float) -> None:
    """A blow and a rest of no effect together: half believed, they would have one."""

    def bounces(time_s: float) -> float:
        within = (time_s * pace_hz) % 1.0
        return size * (4.0 if within < 0.2 else -1.0) if 2.0 < time_s < 3.0 else 0.0

    _, estimate = follow(lambda _: 0.0, duration_s=6.0, by_feet=bounces)
    assert np.abs(estimate).max() < 0.002


@pytest.mark.parametrize("phase_deg", [0.0, 120.0, 240.0])
@pytest.mark.parametrize(("frequency_hz", "bias"), [(0.96, 0.0), (0.5, 0.05)])
def test_ground_that_moves_at_the_start_is_no_bias(
    frequency_hz: float, bias: float, phase_deg: float
) -> None:
    """Taken for one, it drove the height to the stroke's end for half a minute."""
    amplitude, phase = 0.06, np.radians(phase_deg)

    def heaving(time_s: float) -> float:
        return amplitude * float(np.sin(2.0 * np.pi * frequency_hz * time_s + phase))

    truth, estimate = follow(heaving, duration_s=9.0, bias=bias, moves=True)
    assert np.abs(estimate).max() < 1.4 * amplitude
    lasting = (estimate - truth)[round(6.0 / PERIOD_S) :]
    assert np.sqrt(np.mean(lasting**2)) < 0.5 * amplitude
    assert abs(np.mean(lasting)) < 0.25 * amplitude


@pytest.mark.parametrize("phase_deg", [0.0, 120.0, 240.0])
@pytest.mark.parametrize("frequency_hz", [0.25, 0.96])
@pytest.mark.parametrize(
    ("bias", "load", "off"), [(0.3, 0.0, 0.15), (0.15, -0.15, 0.15), (-0.3, -0.25, 0.6)]
)
def test_a_large_bias_on_ground_that_moves_at_the_start_is_learnt(
    bias: float, load: float, off: float, frequency_hz: float, phase_deg: float
) -> None:
    """Feet that are off by a load may show it, or hide it: that takes longer."""
    amplitude, phase = 0.05, np.radians(phase_deg)

    def heaving(time_s: float) -> float:
        return amplitude * float(np.sin(2.0 * np.pi * frequency_hz * time_s + phase))

    truth, estimate = follow(
        heaving, duration_s=14.0, bias=bias, by_feet=lambda _: load, moves=True
    )
    lasting = (estimate - truth)[round(10.0 / PERIOD_S) :]
    assert abs(np.mean(lasting)) < off * amplitude
    assert np.abs(estimate).max() < 1.4 * amplitude


def swinging(time_s: float, *, frequency_hz: float) -> float:
    moved = frequency_hz * max(time_s - 1.0, 0.0)
    fade = min(moved, 1.0)
    return 0.05 * fade * fade * float(np.sin(2.0 * np.pi * moved))


@pytest.mark.parametrize("frequency_hz", [0.3, 0.8])
@pytest.mark.parametrize(("bias", "drift"), [(0.0, 0.03 / 60.0), (0.2, -0.03 / 60.0)])
def test_a_drift_is_followed_on_ground_that_swings(
    frequency_hz: float, bias: float, drift: float
) -> None:
    """Told from a swing by its pace; pulled slowly, the height was 20 to 40 mm off."""
    truth, estimate = follow(
        lambda t: swinging(t, frequency_hz=frequency_hz),
        duration_s=60.0,
        bias=bias,
        drift=drift,
    )
    lasting = (estimate - truth)[round(20.0 / PERIOD_S) :]
    assert np.sqrt(np.mean(lasting**2)) < 8e-3


@pytest.mark.parametrize("steps", [False, True])
def test_who_walks_is_on_other_ground_at_each_step(
    monkeypatch: pytest.MonkeyPatch, steps: bool
) -> None:
    asked: list[float] = []

    def counted(
        swing: GroundSwing, error: float, *, size: float, moves: float
    ) -> float:
        asked.append(swing.share)
        return error

    monkeypatch.setattr(GroundSwing, "follow", counted)
    follow(lambda t: swinging(t, frequency_hz=0.5), duration_s=6.0, steps=steps)
    assert bool(asked) is not steps


def test_waves_of_several_lengths_are_no_swing_of_one_pace() -> None:
    """Taken for one, they would be let into the height."""
    ground = GroundSwing(period_s=PERIOD_S)
    for time_s in PERIOD_S * np.arange(round(30.0 / PERIOD_S)):
        speed = 0.05 * np.cos(1.3 * time_s) + 0.06 * np.cos(2.9 * time_s)
        ground.update(float(speed))
        ground.follow(-0.02 * float(np.sin(time_s)), size=0.1, moves=1.0)
        assert time_s < 10.0 or ground.share < 0.05


@pytest.mark.parametrize(
    ("frequency_hz", "slow_m_s"), [(0.18, 0.0), (0.22, 0.0), (0.5, 0.005), (1.1, 0.005)]
)
def test_the_pace_is_read_within_ten_seconds(
    frequency_hz: float, slow_m_s: float
) -> None:
    """Also where a bias that is found out later goes along."""
    pace = Pace(period_s=PERIOD_S)
    for time_s in PERIOD_S * np.arange(round(10.0 / PERIOD_S)):
        before, after = (
            swinging(time_s + d, frequency_hz=frequency_hz) for d in (-STEP_S, STEP_S)
        )
        slow = slow_m_s * float(np.sin(0.4 * time_s))
        pace.update((after - before) / (2.0 * STEP_S) + slow)
    assert pace.value == pytest.approx(2.0 * np.pi * frequency_hz, rel=0.1)
    assert pace.purity > 0.9
