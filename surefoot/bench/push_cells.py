"""Pushes of DYSTURBANCE, and the search for the largest one that a robot stands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from surefoot.bench.bench_runs import NOISE, BenchCell, Subject, Under
from surefoot.bench.sway_response import phasor
from surefoot.schemas.arrays import GRAVITY_M_S2
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_robot import DisplacementRod, ForceRod, Rod, StrikeRod
from surefoot.sim_robot.pushes import RodState
from surefoot.simulation import Simulation

WITHIN = 1.02
"""Ratio of the smallest failed push to the largest stood one that ends a search."""
STEP = 2.0
"""Factor from size to size until one push was stood and one was not."""
MOST_STEPS = 6
DIGITS = 4
KINDS: tuple[PushKind, ...] = (
    *("impulse", "sine-displacement", "sine-force"),
    *("slow-displacement", "slow-force"),
)
SINES = ("sine-displacement", "sine-force")
UNITS: dict[PushKind, str] = {
    "impulse": "m/s",
    "sine-displacement": "m",
    "sine-force": "N",
    "slow-displacement": "m",
    "slow-force": "N",
}
START_S = 0.5
AFTER_STRIKE_S = 3.5
RISE_S = 3.0
HELD_S = 4.0
"""Longer than a pendulum of the robot's height takes to fall: a push that is slightly
too large has made it fall by then [s]."""
PERIODS = 3
LEAST_SINE_S = RISE_S + HELD_S
"""Least duration of a sine: a robot that drifts further each period has fallen [s]."""
STRIKER_SHARE = 0.1
"""Mass of the striker over that of the robot."""
STIFFNESS_PER_KG, DAMPING_PER_KG = 1.6e3, 24.0
"""Stiffness and damping between rod and robot, per robot mass [N/m/kg, N s/m/kg]."""
PAD_PER_KG = 300.0
"""Stiffness of the striker's pad, per robot mass [N/m/kg]."""


class Impedance(NamedTuple):
    """Mass, damper and spring with the same response as the robot.

    Attributes:
        inertia_kg: equivalent mass [kg].
        damping_n_s_m: equivalent damping [N s/m].
        stiffness_n_m: equivalent stiffness [N/m].
    """

    inertia_kg: float
    damping_n_s_m: float
    stiffness_n_m: float


def fit_impedance(
    frequencies_hz: Sequence[float], force_over_way: Sequence[complex]
) -> Impedance | None:
    """Fit an impedance to force over displacement by least squares.

    A sine at one frequency cannot tell a spring from a mass: both respond in phase.
    Several are fitted together: F/X = K - I w^2 + j w D. Relative errors are used, or
    the highest frequency would decide alone.

    Args:
        frequencies_hz: of the sines [Hz].
        force_over_way: complex amplitude of force over displacement [N/m].

    Returns:
        None for fewer than two frequencies.
    """
    if len(set(frequencies_hz)) < 2:
        return None
    omega = 2.0 * np.pi * np.array(frequencies_hz)
    z = np.array(force_over_way)
    weight = 1.0 / np.abs(z)
    in_phase = np.column_stack([-(omega**2), np.ones_like(omega)]) * weight[:, None]
    (inertia, stiffness), *_ = np.linalg.lstsq(in_phase, z.real * weight, rcond=None)
    quarter = omega * weight
    damping = float(quarter @ (z.imag * weight) / (quarter @ quarter))
    return Impedance(float(inertia), damping, float(stiffness))


@dataclass
class MarginSearch:
    """A bisection for the largest push that the robot stands.

    It assumes that a robot that stands a push stands every smaller one.

    Attributes:
        size: size to try next.
        stood: largest size that the robot stood; 0 if none.
        fell: smallest size that it did not stand; None if it stood all.
        tried: number of sizes tried.
    """

    size: float
    stood: float = 0.0
    fell: float | None = None
    tried: int = field(default=0)

    def __post_init__(self) -> None:
        """Round the size to few digits: a stored run is found by its name."""
        self.size = _rounded(self.size)

    @property
    def is_done(self) -> bool:
        """Whether the margin is known to within 2 %, or the tries are used up."""
        if self.stood and self.fell is not None:
            # Between some neighbours there is no size of few digits.
            return self.fell <= WITHIN * self.stood or self.size in (
                self.stood,
                self.fell,
            )
        return self.tried > MOST_STEPS

    def tell(self, *, stood: bool) -> None:
        """Note whether the robot stood ``size``, and choose the next."""
        self.tried += 1
        if stood:
            self.stood = max(self.stood, self.size)
        else:
            self.fell = self.size if self.fell is None else min(self.fell, self.size)
        if self.fell is None:
            self.size = _rounded(self.size * STEP)
        elif not self.stood:
            self.size = _rounded(self.size / STEP)
        else:
            self.size = _rounded(math.sqrt(self.stood * self.fell))


def _rounded(size: float) -> float:
    return float(f"{size:.{DIGITS}g}")


PushKind = Literal[
    "impulse", "sine-displacement", "sine-force", "slow-displacement", "slow-force"
]


class Disturbance(NamedTuple):
    """A push without its size.

    Attributes:
        kind: kind of push.
        direction_deg: 0 ahead, 90 to the left.
        frequency_hz: of a sine; 0 for the others.
    """

    kind: PushKind
    direction_deg: float
    frequency_hz: float = 0.0

    @property
    def words(self) -> str:
        """Return it in words."""
        turn = f"{self.kind} {self.direction_deg:g} deg"
        return f"{turn} {self.frequency_hz:g} Hz" if self.frequency_hz else turn


@dataclass(frozen=True, kw_only=True)
class PushCell(BenchCell):
    """A run of DYSTURBANCE.

    Attributes:
        disturbance: the push.
    """

    disturbance: Disturbance

    def probe(self) -> PushProbe:
        """Return a new probe for a run."""
        return PushProbe(self.disturbance.frequency_hz)


def push_cell(
    disturbance: Disturbance,
    size: float,
    under: Under,
    *,
    subject: Subject,
    body: str,
) -> PushCell:
    """Build the run of a push.

    Args:
        disturbance: the push.
        size: of the push, in the unit of its kind.
        under: controller and servo profile.
        subject: measures of the robot; the rod is scaled to them.
        body: link that is pushed.
    """
    case = f"{disturbance.words}, {size:g} {UNITS[disturbance.kind]}"
    scenario = Scenario(
        name=f"dysturbance {case}",
        duration_s=START_S + _lasts_s(disturbance),
        rod=[_rod(disturbance, size, subject=subject, body=body)],
        sensors=NOISE,
    )
    return PushCell(case=case, scenario=scenario, under=under, disturbance=disturbance)


def first_guess(disturbance: Disturbance, subject: Subject) -> float:
    """Return the size at which a linear inverted pendulum like the robot would tip."""
    mass, height = subject.mass_kg, subject.com_height_m
    base = subject.base_m(disturbance.direction_deg)
    own = math.sqrt(GRAVITY_M_S2 / height)
    swing = 1.0 + (math.tau * disturbance.frequency_hz / own) ** 2
    match disturbance.kind:
        case "impulse":
            return own * base / (2.0 * STRIKER_SHARE)
        case "sine-displacement" | "slow-displacement":
            return base / swing
    return mass * GRAVITY_M_S2 * base / height


def _lasts_s(disturbance: Disturbance) -> float:
    if disturbance.kind in SINES:
        periods = max(
            PERIODS + 1, math.ceil(LEAST_SINE_S * disturbance.frequency_hz) + 1
        )
        return math.ceil(100.0 * periods / disturbance.frequency_hz) / 100.0
    return AFTER_STRIKE_S if disturbance.kind == "impulse" else RISE_S + HELD_S


def _rod(disturbance: Disturbance, size: float, *, subject: Subject, body: str) -> Rod:
    turn, mass = disturbance.direction_deg, subject.mass_kg
    if disturbance.kind == "impulse":
        return StrikeRod(
            body=body,
            direction_deg=turn,
            start_s=START_S,
            mass_kg=STRIKER_SHARE * mass,
            speed_m_s=size,
            stiffness_n_m=PAD_PER_KG * mass,
        )
    swings = disturbance.kind in SINES
    frequency_hz = disturbance.frequency_hz if swings else None
    rise_s = None if swings else RISE_S
    if disturbance.kind.endswith("force"):
        return ForceRod(
            body=body,
            direction_deg=turn,
            start_s=START_S,
            amplitude_n=size,
            frequency_hz=frequency_hz,
            rise_s=rise_s,
        )
    return DisplacementRod(
        body=body,
        direction_deg=turn,
        start_s=START_S,
        amplitude_m=size,
        frequency_hz=frequency_hz,
        rise_s=rise_s,
        stiffness_n_m=STIFFNESS_PER_KG * mass,
        damping_n_s_m=DAMPING_PER_KG * mass,
    )


class PushProbe:
    """Follows the rod, and measures energy, impulse, force and displacement."""

    def __init__(self, frequency_hz: float) -> None:
        """Begin without measurements.

        Args:
            frequency_hz: of a sine; 0 for the others.
        """
        self._frequency_hz = frequency_hz
        self._period_s = 0.0
        self._states: list[RodState] = []

    def look(self, sim: Simulation) -> None:
        """Take in the present tick."""
        self._period_s = sim.robot.period_s
        self._states.append(sim.simulated.plant.rods[0].state)

    def figures(self) -> dict[str, Any]:
        """Return energy, impulse, force and displacement of a complete run."""
        last = self._states[-1]
        found: dict[str, Any] = {
            "peak_n": last.peak_n,
            "impulse_n_s": last.impulse_n_s,
            "work_j": last.work_j,
            "way_m": max(abs(state.position_m) for state in self._states),
        }
        if self._frequency_hz:
            found |= self._swing()
        return found

    def _swing(self) -> dict[str, Any]:
        """Force over displacement, and work per period, over the last whole periods."""
        per_period = round(1.0 / (self._frequency_hz * self._period_s))
        periods = min(PERIODS, (len(self._states) - 1) // per_period - 1)
        states = self._states[-(periods * per_period) - 1 :]
        force = np.array([state.force_n for state in states[:-1]])
        way = np.array([state.position_m for state in states[:-1]])
        ratio = phasor(
            force, period_s=self._period_s, frequency_hz=self._frequency_hz
        ) / phasor(way, period_s=self._period_s, frequency_hz=self._frequency_hz)
        work = (states[-1].work_j - states[0].work_j) / periods
        return {"force_over_way": [ratio.real, ratio.imag], "work_per_period_j": work}
