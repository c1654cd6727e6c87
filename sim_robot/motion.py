"""Analytic motions of the ground along one axis: position and its exact derivative."""

from __future__ import annotations

import math
from collections.abc import Callable

from surefoot.schemas.scenario import DropMotion, Motion, RampMotion, SineMotion
from surefoot.sim_robot.errors import ScenarioError

GRAVITY_M_S2 = 9.81
BLEND_S = 0.020
"""Ramps and drops start and stop over this time [s]."""
MotionLaw = Callable[[float], tuple[float, float]]
"""Time [s] to (position, velocity) in SI; at rest in zero until the motion starts."""


def motion_law(motion: Motion) -> MotionLaw:
    """Turn a motion of the scenario file into a function of time.

    Args:
        motion: sine, ramp or drop; its axis does not matter here.

    Raises:
        ScenarioError: a free fall that does not go down.
    """
    if isinstance(motion, SineMotion):
        return _sine(motion)
    if isinstance(motion, RampMotion):
        return _ramp(motion.amplitude, rate=motion.rate, start_s=motion.start_s)
    return _drop(motion)


def _sine(motion: SineMotion) -> MotionLaw:
    """Make A(u) sin(w s + phase), u = s f, faded in over one period, C2 smooth."""
    amplitude, start_s = motion.amplitude, motion.start_s
    frequency_hz = motion.frequency_hz
    omega = math.tau * frequency_hz
    phase = math.radians(motion.phase_deg)

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        angle = omega * since + phase
        position = amplitude * math.sin(angle)
        velocity = amplitude * omega * math.cos(angle)
        u = since * frequency_hz
        if u >= 1.0:
            return position, velocity
        fade = u * u * u * (10.0 + u * (6.0 * u - 15.0))
        fade_rate = 30.0 * u * u * (1.0 - u) * (1.0 - u) * frequency_hz
        return fade * position, fade * velocity + fade_rate * position

    return law


def _ramp(amplitude: float, *, rate: float, start_s: float) -> MotionLaw:
    """Make a motion that speeds up over a blend, cruises and slows down.

    A ramp too short to reach its rate has no cruise and a lower peak.
    """
    size = abs(amplitude)
    peak = min(rate, size / BLEND_S) if size else 0.0
    cruise_end = size / peak if peak else 0.0
    peak = math.copysign(peak, amplitude)

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        if since < BLEND_S:
            travelled, speed = _speed_up(since)
            return peak * travelled, peak * speed
        if since <= cruise_end:
            return peak * (since - 0.5 * BLEND_S), peak
        left = cruise_end + BLEND_S - since
        if left <= 0.0:
            return amplitude, 0.0
        travelled, speed = _speed_up(left)
        return amplitude - peak * travelled, peak * speed

    return law


def _drop(motion: DropMotion) -> MotionLaw:
    """Make a free fall that brakes over a blend and rests at the amplitude."""
    if motion.rate is not None:
        return _ramp(motion.amplitude, rate=motion.rate, start_s=motion.start_s)
    amplitude, start_s = motion.amplitude, motion.start_s
    if amplitude > 0.0:
        raise ScenarioError(
            f"drop: got amplitude_m = {amplitude}, expected a negative one: nothing "
            "falls freely upwards; give a rate_m_s to lift the platform",
            field="amplitude_m",
        )
    # g t^2 / 2 + g t blend / 2 = -amplitude: fall for t, then brake from g t.
    fall_s = 0.5 * (
        math.sqrt(BLEND_S * BLEND_S - 8.0 * amplitude / GRAVITY_M_S2) - BLEND_S
    )
    impact = GRAVITY_M_S2 * fall_s

    def law(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        if since <= 0.0:
            return 0.0, 0.0
        if since <= fall_s:
            return -0.5 * GRAVITY_M_S2 * since * since, -GRAVITY_M_S2 * since
        left = fall_s + BLEND_S - since
        if left <= 0.0:
            return amplitude, 0.0
        travelled, speed = _speed_up(left)
        return amplitude + impact * travelled, -impact * speed

    return law


def _speed_up(time_s: float) -> tuple[float, float]:
    """Return distance and speed, ``time_s`` into a smooth start to unit speed."""
    u = time_s / BLEND_S
    return BLEND_S * u * u * u * (1.0 - 0.5 * u), u * u * (3.0 - 2.0 * u)
