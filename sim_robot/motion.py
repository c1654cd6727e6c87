"""Laws of the ground's motion along one axis: position and its exact derivative.

The laws of each kind take the time since the motion's start.

The ternary sequence is the stimulus of Peterka (2002, J. Neurophysiol. 88) as the
COMTEST protocol of EUROBENCH uses it (Lippi et al., arXiv 2104.11935).
"""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import GRAVITY_M_S2, Array
from surefoot.schemas.motions import (
    BLEND_S,
    DropMotion,
    Motion,
    PrtsMotion,
    RampMotion,
    SineMotion,
    SpectrumMotion,
)
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.conventions import FASTEST_HZ, MotionLaw
from surefoot.sim_robot.recorded import recorded_law

STATES = 80
"""Number of states in a cycle: 3 ** 4 - 1."""
COMPONENTS = 256
LOWEST, HIGHEST = 0.5, 4.0
"""Band of the components, in peak frequencies; it has 99.5 % of the variance."""


def motion_law(motion: Motion) -> MotionLaw:
    """Turn a motion of the scenario file into a function of time.

    Raises:
        ScenarioError: a free fall goes up, a motion is faster than the simulation can
            show, or a record cannot be used; ``field`` is the key within the motion.
    """
    check_blend(motion)
    match motion:
        case SineMotion():
            law = _sine(motion)
        case RampMotion():
            law = _ramp(motion, motion.amplitude, rate=motion.rate)
        case DropMotion():
            law = _drop(motion)
        case PrtsMotion():
            law = _prts(motion)
        case SpectrumMotion():
            law = _spectrum(motion)
        case _:
            return recorded_law(motion)
    start_s = motion.start_s

    def started(time_s: float) -> tuple[float, float]:
        since = time_s - start_s
        return law(since) if since > 0.0 else (0.0, 0.0)

    return started


def _sine(motion: SineMotion) -> MotionLaw:
    """Make A(u) sin(w s + phase), faded in over one period or the blend, C2 smooth."""
    amplitude, frequency_hz = motion.amplitude, motion.frequency_hz
    check_frequency(frequency_hz, "frequency_hz")
    per_fade = frequency_hz if motion.blend_s is None else 1.0 / motion.blend_s
    omega = math.tau * frequency_hz
    phase = math.radians(motion.phase_deg)

    def law(since: float) -> tuple[float, float]:
        angle = omega * since + phase
        return amplitude * math.sin(angle), amplitude * omega * math.cos(angle)

    return _faded_in(law, per_fade)


def _ramp(
    motion: RampMotion | DropMotion, amplitude: float, *, rate: float
) -> MotionLaw:
    """Make a motion that speeds up over a blend, cruises and slows down.

    A ramp too short to reach its rate has no cruise and a lower peak.
    """
    blend = _blend_s(motion)
    size = abs(amplitude)
    peak = min(rate, size / blend) if size else 0.0
    cruise_end = size / peak if peak else 0.0
    peak = math.copysign(peak, amplitude)

    def law(since: float) -> tuple[float, float]:
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
    amplitude, blend = motion.amplitude, _blend_s(motion)
    if amplitude > 0.0:
        raise ScenarioError(
            f"amplitude_m: got {amplitude}, expected a negative one: nothing "
            "falls freely upwards; give a rate_m_s to lift the platform",
            field="amplitude_m",
        )
    # g t^2 / 2 + g t blend / 2 = -amplitude: fall for t, then brake from g t.
    fall_s = 0.5 * (math.sqrt(blend * blend - 8.0 * amplitude / GRAVITY_M_S2) - blend)
    impact = GRAVITY_M_S2 * fall_s

    def law(since: float) -> tuple[float, float]:
        if since <= fall_s:
            return -0.5 * GRAVITY_M_S2 * since * since, -GRAVITY_M_S2 * since
        left = fall_s + blend - since
        if left <= 0.0:
            return amplitude, 0.0
        travelled, speed = _speed_up(left, blend)
        return amplitude + impact * travelled, -impact * speed

    return law


def _speed_up(time_s: float, blend: float) -> tuple[float, float]:
    """Return distance and speed ``time_s`` after a smooth start to unit speed."""
    u = time_s / blend
    return blend * u * u * u * (1.0 - 0.5 * u), u * u * (3.0 - 2.0 * u)


def _blend_s(motion: RampMotion | DropMotion) -> float:
    return BLEND_S if motion.blend_s is None else motion.blend_s


def fade(u: float) -> tuple[float, float]:
    """Return the share of a motion that fades in, C2 smooth, and its slope.

    Args:
        u: progress of the fade, from 0 to 1.
    """
    share = u * u * u * (10.0 + u * (6.0 * u - 15.0))
    return share, 30.0 * u * u * (1.0 - u) * (1.0 - u)


def _faded_in(law: MotionLaw, per_fade: float) -> MotionLaw:
    """Fade a motion in over ``1 / per_fade`` [s]."""

    def faded(since: float) -> tuple[float, float]:
        position, velocity = law(since)
        u = since * per_fade
        if u >= 1.0:
            return position, velocity
        share, rate = fade(u)
        return share * position, share * velocity + rate * per_fade * position

    return faded


def check_blend(motion: Motion) -> None:
    """Refuse a blend shorter than two steps of the simulation.

    Raises:
        ScenarioError: the blend is too short.
    """
    if motion.blend_s is not None and motion.blend_s < 1.0 / FASTEST_HZ:
        raise ScenarioError(
            f"blend_s: got {motion.blend_s:g} s, expected at least "
            f"{1.0 / FASTEST_HZ:g} s, two steps of the simulation",
            field="blend_s",
        )


def check_frequency(frequency_hz: float, key: str, *, what: str = "") -> None:
    """Refuse a frequency above half the simulation's rate.

    Args:
        frequency_hz: highest frequency of the motion [Hz].
        key: key of the motion that sets it.
        what: the setting in words, if the key is not the frequency itself.

    Raises:
        ScenarioError: the frequency is too high.
    """
    if frequency_hz > FASTEST_HZ:
        raise ScenarioError(
            f"{key}: got {what or f'{frequency_hz:g} Hz'}, expected at most "
            f"{FASTEST_HZ:g} Hz, half the simulation's rate; slow it down",
            field=key,
        )


def prts_states() -> list[int]:
    """Return the states of a cycle: 80 of -1, 0 and 1.

    A shift register of four ternary stages starts at 0 0 0 1 and puts out its last
    stage. Its input is the last stage minus the third, modulo 3. State 2 means -1.
    """
    register, states = [0, 0, 0, 1], []
    for _ in range(STATES):
        states.append((0, 1, -1)[register[3]])
        register = [(register[3] - register[2]) % 3, *register[:3]]
    return states


def _prts(motion: PrtsMotion) -> MotionLaw:
    """Make the integral of the states, with the velocity blended at each change.

    A change begins with its state and takes one blend, as a smooth step. So the
    position is that of the abrupt sequence averaged over the past blend, and ends where
    it began.

    Raises:
        ScenarioError: the sequence is faster than half the simulation's rate.
    """
    state_s, blend, rate = motion.state_s, motion.blend, motion.rate
    check_frequency(0.5 / state_s, "speed", what=f"states of {1e3 * state_s:g} ms, so")
    states: Array = np.array(prts_states() * motion.cycles, dtype=np.float64)
    velocity = (rate * np.append(states, 0.0)).tolist()
    before = [0.0, *velocity[:-1]]
    # Travel of a state: its own velocity, minus what the blend takes off.
    lacks = 0.5 * blend * np.diff(rate * states, prepend=0.0)
    travelled = np.cumsum(rate * states * state_s - lacks)
    position = [0.0, *travelled.tolist()]
    last = len(velocity) - 1

    def law(since: float) -> tuple[float, float]:
        index = min(int(since / state_s), last)
        since -= index * state_s
        begin, change = before[index], velocity[index] - before[index]
        if since >= blend:
            moved = begin * since + change * (since - 0.5 * blend)
            return position[index] + moved, velocity[index]
        u = since / blend
        moved = begin * since + change * blend * u * u * u * (1.0 - 0.5 * u)
        return position[index] + moved, begin + change * u * u * (3.0 - 2.0 * u)

    return law


def jonswap(frequency_hz: Array, *, peak_hz: float, gamma: float) -> Array:
    """Return the shape of the JONSWAP spectrum, (n,), not scaled.

    Hasselmann et al. (1973): f^-5 exp(-5/4 (f/fp)^-4) gamma^r, with
    r = exp(-(f - fp)^2 / (2 sigma^2 fp^2)), sigma = 0.07 below the peak and 0.09 above.

    Args:
        frequency_hz: (n,) frequencies, above zero [Hz].
        peak_hz: frequency of the peak [Hz].
        gamma: peak enhancement factor.
    """
    relative = frequency_hz / peak_hz
    sigma = np.where(relative <= 1.0, 0.07, 0.09)
    peak = np.exp(-((relative - 1.0) ** 2) / (2.0 * sigma**2))
    shape: Array = relative**-5 * np.exp(-1.25 * relative**-4) * gamma**peak
    return shape


def components(motion: SpectrumMotion) -> tuple[Array, Array, Array]:
    """Return frequencies [Hz], amplitudes of the waves [m] and phases [rad], (256,).

    Each of equally wide bands has one component at a random place, so the sum does not
    repeat itself. Amplitudes follow the spectrum, and their variances add up exactly to
    height^2 / 16.
    """
    peak_hz = 1.0 / motion.period_s
    random = np.random.default_rng(np.random.SeedSequence(motion.seed))
    width = (HIGHEST - LOWEST) / COMPONENTS
    places = np.arange(COMPONENTS) + random.random(COMPONENTS)
    frequency_hz = peak_hz * (LOWEST + width * places)
    variance = jonswap(frequency_hz, peak_hz=peak_hz, gamma=motion.gamma)
    variance *= motion.height_m**2 / 16.0 / variance.sum()
    return frequency_hz, np.sqrt(2.0 * variance), math.tau * random.random(COMPONENTS)


def _spectrum(motion: SpectrumMotion) -> MotionLaw:
    """Make the sum of the components times the gain, faded in, C2 smooth.

    Raises:
        ScenarioError: a component is faster than half the simulation's rate.
    """
    check_frequency(
        HIGHEST / motion.period_s,
        "period_s",
        what=f"{motion.period_s:g} s, so waves of up to "
        f"{HIGHEST / motion.period_s:g} Hz",
    )
    frequency_hz, height, phase = components(motion)
    omega = math.tau * frequency_hz
    amplitude = motion.gain_si * height
    amplitude_rate = -amplitude * omega
    phase = phase + math.radians(motion.phase_deg)
    per_fade = 1.0 / (motion.period_s if motion.blend_s is None else motion.blend_s)

    def law(since: float) -> tuple[float, float]:
        angle = omega * since
        angle += phase
        position = float(amplitude @ np.cos(angle))
        return position, float(amplitude_rate @ np.sin(angle))

    return _faded_in(law, per_fade)
