"""What the evaluation runs: scenarios, controllers, servo profiles."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.studies.cell import Cell, Group

WHOLE_BODY, PAPER, TUNED, STOCK = "whole-body", "paper", "zmp-tuned", "zmp-stock"
IDEAL, SLOW = "ideal", "harmonic"
PROFILES = (IDEAL, SLOW)
CORE = (
    "moving-platform-slow",
    "moving-platform-fast",
    "two-platforms-slow",
    "two-platforms-fast",
    "falling-platform-50",
    "falling-platform-80",
    "tilt-ramp-roll",
    "tilt-ramp-pitch",
    "tilt-ramp-diagonal",
    "tilt-sine-roll",
    "tilt-sine-pitch",
)
"""The paper's scenarios, and tilts at the rates we set ourselves."""
PUSHED = ("push-standing", "push-slow-platform")
DIRECTION = "push.0.direction_deg"
DIRECTIONS = tuple(45.0 * i for i in range(8))
RAMPS = ("tilt-ramp-roll", "tilt-ramp-pitch", "tilt-ramp-diagonal")
TILT_RATE = "tilt_rate_deg_s"
PAPER_LIMIT_DEG_S = 60.0
ROBUSTNESS_ON = "moving-platform-fast"
ROBUSTNESS = (
    (("sensors.force_noise_n", 5.0), ("sensors.moment_noise_nm", 0.5)),
    (("delay.command_ms", 2.0),),
    (("model_error.servo_kp_scale", 0.8),),
    (("model_error.servo_kp_scale", 1.2),),
    (("model_error.mass_scale", 0.9),),
    (("model_error.mass_scale", 1.1),),
    (("friction", 0.4),),
    (("friction", 1.0),),
)
FULL_SEEDS, QUICK_SEEDS = 50, 1


@dataclass(frozen=True)
class Extent:
    """How much of it is run.

    Attributes:
        seeds: 0 to this, without.
        variants: controllers.
        rates: of the tilt ramps, for the limit [deg/s].
    """

    seeds: int
    variants: tuple[str, ...]
    rates: tuple[float, ...]


def extent(*, quick: bool, seeds: int | None) -> Extent:
    """Return the full study, or the quick one with fewer seeds, rates, controllers."""
    if quick:
        return Extent(
            seeds or QUICK_SEEDS, (WHOLE_BODY, TUNED), (60.0, 120.0, 180.0, 240.0)
        )
    rates = (60.0, 90.0, 120.0, 150.0, 180.0, 240.0, 300.0)
    return Extent(seeds or FULL_SEEDS, (WHOLE_BODY, PAPER, TUNED, STOCK), rates)


def cells_of(size: Extent) -> list[Cell]:
    """Return all runs, a whole round before the next seed."""
    groups: list[Group] = []
    for variant in size.variants:
        for profile in PROFILES:
            groups += [Group(name, (), variant, profile) for name in CORE]
            groups += [
                Group(name, ((TILT_RATE, rate),), variant, profile)
                for name in RAMPS
                for rate in size.rates
            ]
        if variant in (WHOLE_BODY, TUNED):
            groups += [
                Group(name, ((DIRECTION, direction),), variant, IDEAL)
                for name in PUSHED
                for direction in DIRECTIONS
            ]
            groups += [
                Group(ROBUSTNESS_ON, values, variant, IDEAL) for values in ROBUSTNESS
            ]
    return [Cell(group, seed) for seed in range(size.seeds) for group in groups]
