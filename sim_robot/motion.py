"""Motions of the ground along one axis: position and its exact derivative."""

from __future__ import annotations

import math

from surefoot.schemas.motions import (
    BLEND_S,
    DropMotion,
    Motion,
    PrtsMotion,
    RampMotion,
    SineMotion,
    SpectrumMotion,
)
from surefoot.sim_robot.errors import ScenarioError
from surefoot.sim_robot.motion_law import (
    MotionLaw,
    check_blend,
    check_frequency,
    fade,
    prts_law,
    spectrum_law,
)
from surefoot.sim_robot.recorded import recorded_law

GRAVITY_M_S2 = 9.81


def motion_law(motion: Motion) -> MotionLaw:
    """Turn a motion of the scenario file into a function of time.

    Args:
        motion: of any kind; its axis does not matter here.

    Raises:
        ScenarioError: a free fall that does not go down, a motion faster than the
            simulation can show, or a record that cannot be used; ``field`` is the key
            within the motion.
    """
    check_blend(motion)
    match motion:
        case SineMotion():
            return _sine(motion)
        case RampMotion():
            return _ramp(motion, motion.amplitude, rate=motion.rate)
        case DropMotion():
            return _drop(motion)
        case PrtsMotion():
            return prts_law(motion)
        case SpectrumMotion():
            return spectrum_law(motion)
    return recorded_law(motion)


def _sine(motion: SineMotion) -> MotionLaw:
    """Make A(u) sin(w s + phase), faded in over one period or the blend, C2 smooth."""
    amplitude, start_s = motion.amplitude, motion.start_s
    frequency_hz = motion.frequency_hz
    check_frequency(frequency_hz, "frequency_hz")
    per_fade = frequency_hz if motion.blend_s is None else 1.0 / motion.blend_s
    omega = math.tau * frequency_hz
    phase = math.radians(motion.phase_deg)

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        angle = omega * since + phase
        position = amplitude * math.sin(angle)
        velocity = amplitude * omega * math.cos(angle)
        u = since * per_fade
        if u >= 1.0:
            return position, velocity
        share, rate = fade(u)
        return share * position, share * velocity + rate * per_fade * position

    return law


def _ramp(
    motion: RampMotion | DropMotion, amplitude: float, *, rate: float
) -> MotionLaw:
    """Make a motion that speeds up over a blend, cruises and slows down.

    A ramp too short to reach its rate has no cruise and a lower peak.
    """
    start_s, blend = motion.start_s, _blend_s(motion)
    size = abs(amplitude)
    peak = min(rate, size / blend) if size else 0.0
    cruise_end = size / peak if peak else 0.0
    peak = math.copysign(peak, amplitude)

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        if since < blend:
            travelled, speed = _speed_up(since, blend)
            return peak * travelled, peak * speed
        if since <= cruise_end:
            return peak * (since - 0.5 * blend), peak
        left = cruise_end + blend - since
        if left <= 0.0:
            return amplitude, 0.0
        travelled, speed = _speed_up(left, blend)
        return amplitude - peak * travelled, peak * speed

    return law


def _drop(motion: DropMotion) -> MotionLaw:
    """Make a free fall that brakes over a blend and rests at the amplitude."""
    if motion.rate is not None:
        return _ramp(motion, motion.amplitude, rate=motion.rate)
    amplitude, start_s, blend = motion.amplitude, motion.start_s, _blend_s(motion)
    if amplitude > 0.0:
        raise ScenarioError(
            f"amplitude_m: got {amplitude}, expected a negative one: nothing "
            "falls freely upwards; give a rate_m_s to lift the platform",
            field="amplitude_m",
        )
    # g t^2 / 2 + g t blend / 2 = -amplitude: fall for t, then brake from g t.
    fall_s = 0.5 * (math.sqrt(blend * blend - 8.0 * amplitude / GRAVITY_M_S2) - blend)
    impact = GRAVITY_M_S2 * fall_s

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        if since <= fall_s:
            return -0.5 * GRAVITY_M_S2 * since * since, -GRAVITY_M_S2 * since
        left = fall_s + blend - since
        if left <= 0.0:
            return amplitude, 0.0
        travelled, speed = _speed_up(left, blend)
        return amplitude + impact * travelled, -impact * speed

    return law


def _speed_up(time_s: float, blend: float) -> tuple[float, float]:
    """Return distance and speed, ``time_s`` into a smooth start to unit speed."""
    u = time_s / blend
    return blend * u * u * u * (1.0 - 0.5 * u), u * u * (3.0 - 2.0 * u)


def _blend_s(motion: RampMotion | DropMotion) -> float:
    return BLEND_S if motion.blend_s is None else motion.blend_s
