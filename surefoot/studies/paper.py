"""The paper's evaluation: its cases, and its claims compared with the results."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from surefoot.studies.cell import Cell, Group
from surefoot.studies.summaries import GroupSummary, Summaries, curves_over

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
"""The paper's scenarios, and tilts at this project's own rates."""
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
HOLDS, FAILS, OPEN = "holds", "does not hold", "not measured"
LOWER_BY = 0.4
HEIGHT_LIMIT_MM = 10.0
REGAIN_S = 0.3
RATE_GOAL_DEG_S = 180.0
HALF = 0.5
ROBUST_SHARE, DROP_80_SHARE = 0.95, 0.9


@dataclass(frozen=True)
class Extent:
    """Extent of the evaluation.

    Attributes:
        seeds: number of seeds, from 0 on.
        variants: controllers.
        rates: rates of the tilt ramps, for the limit [deg/s].
    """

    seeds: int
    variants: tuple[str, ...]
    rates: tuple[float, ...]


def extent(*, quick: bool, seeds: int | None) -> Extent:
    """Return the full extent, or the quick one: fewer seeds, rates and controllers."""
    if quick:
        return Extent(
            seeds or QUICK_SEEDS, (WHOLE_BODY, TUNED), (60.0, 120.0, 180.0, 240.0)
        )
    rates = (60.0, 90.0, 120.0, 150.0, 180.0, 240.0, 300.0)
    return Extent(seeds or FULL_SEEDS, (WHOLE_BODY, PAPER, TUNED, STOCK), rates)


def cells_of(size: Extent) -> list[Cell]:
    """Return all runs: all cases with one seed, then with the next."""
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


@dataclass(frozen=True)
class Claim:
    """A statement and its measurement.

    Attributes:
        statement: the claim or the goal.
        measured: result in words and numbers.
        verdict: HOLDS, FAILS or OPEN.
    """

    statement: str
    measured: str
    verdict: str


class Evidence:
    """Looks up results by group."""

    def __init__(self, summaries: Summaries) -> None:
        """Take all summaries of a study."""
        self.summaries = summaries

    def of(self, scenario: str, variant: str, **values: float) -> GroupSummary | None:
        """Return a group's summary with ideal servos; None if it was not run."""
        return self.summaries.get(
            Group(scenario, tuple(values.items()), variant, IDEAL)
        )

    def where(self, wanted: Callable[[Group], bool]) -> list[GroupSummary]:
        """Return the summaries of all groups for which ``wanted`` is true."""
        return [s for group, s in self.summaries.items() if wanted(group)]


def claims(evidence: Evidence) -> list[Claim]:
    """Return the paper's claims; ZMP is the tuned baseline unless stated."""
    slow, fast = "moving-platform-slow", "moving-platform-fast"
    pair_slow, pair_fast = "two-platforms-slow", "two-platforms-fast"
    return [
        _both_and_better(evidence, slow, "One platform, slow"),
        _only_whole_body(evidence, fast, "One platform, fast"),
        _both_and_better(evidence, pair_slow, "A platform per foot, slow"),
        _only_whole_body(evidence, pair_fast, "A platform per foot, fast"),
        _only_whole_body(evidence, "falling-platform-50", "Ground falls by 50 mm"),
        _only_whole_body(evidence, "falling-platform-80", "Ground falls by 80 mm"),
        _limit_of(
            evidence,
            PAPER,
            "Its own law balances up to about 60 deg/s",
            at=PAPER_LIMIT_DEG_S,
        ),
    ]


def goals(evidence: Evidence) -> list[Claim]:
    """Return this project's own goals, for default settings."""
    one = evidence.of("moving-platform-slow", WHOLE_BODY)
    height = None if one is None or one.com_rms_mm is None else one.com_rms_mm[2]
    worst = (
        None if one is None or one.com_rms_worst_mm is None else one.com_rms_worst_mm[2]
    )
    return [
        _lower_everywhere(evidence),
        *(
            _share(evidence, name, 1.0, f"{name} at 60 deg/s: all stay up")
            for name in RAMPS
        ),
        _limit_of(
            evidence,
            WHOLE_BODY,
            f"Half stay up at {RATE_GOAL_DEG_S:g} deg/s or more",
            at=RATE_GOAL_DEG_S,
        ),
        _share(evidence, "tilt-sine-roll", 1.0, "Roll sine, 120 deg/s peak: all up"),
        _share(evidence, "tilt-sine-pitch", 1.0, "Pitch sine, 120 deg/s peak: all up"),
        _share(evidence, "two-platforms-fast", 1.0, "Two platforms, fast: all up"),
        _drop(evidence),
        _share(evidence, "falling-platform-80", DROP_80_SHARE, "80 mm drop: 90 % up"),
        _many(
            evidence.where(lambda g: g.scenario in PUSHED and g.variant == WHOLE_BODY),
            1.0,
            "20 N s from eight directions, still and slowly moving ground: all up",
        ),
        _many(
            evidence.where(
                lambda g: (
                    g.scenario == ROBUSTNESS_ON
                    and g.values in ROBUSTNESS
                    and g.variant == WHOLE_BODY
                )
            ),
            ROBUST_SHARE,
            "Noise, delay, servo stiffness, mass and friction: 95 % up",
        ),
        Claim(
            f"CoM height on the slow platform: at most {HEIGHT_LIMIT_MM:g} mm rms",
            "-" if height is None else f"mean {height:.1f}, worst seed {worst:.1f} mm",
            _verdict(None if worst is None else worst <= HEIGHT_LIMIT_MM),
        ),
    ]


def _verdict(true: bool | None) -> str:
    return OPEN if true is None else HOLDS if true else FAILS


def _ups(name: str, summary: GroupSummary | None) -> str:
    if summary is None:
        return f"{name}: not run"
    return f"{name}: {summary.up} of {summary.runs} up"


def _better(ours: GroupSummary, theirs: GroupSummary) -> str:
    return (
        f"CoM rms {ours.horizontal_mm:.1f} against {theirs.horizontal_mm:.1f} mm, "
        f"force deviation {ours.force_deviation_n:.0f} against "
        f"{theirs.force_deviation_n:.0f} N"
    )


def _both_and_better(evidence: Evidence, scenario: str, title: str) -> Claim:
    ours, theirs = (evidence.of(scenario, v) for v in (WHOLE_BODY, TUNED))
    statement = f"{title}: both stay up, whole-body with less CoM motion and force"
    words = "; ".join((_ups(WHOLE_BODY, ours), _ups(TUNED, theirs)))
    if ours is None or theirs is None:
        return Claim(statement, words, OPEN)
    if not ours.up or not theirs.up:
        return Claim(statement, words, FAILS)
    true = (
        ours.up == ours.runs
        and theirs.up == theirs.runs
        and _ratio(ours.horizontal_mm, theirs.horizontal_mm) < 1.0
        and _ratio(ours.force_deviation_n, theirs.force_deviation_n) < 1.0
    )
    return Claim(statement, f"{words}; {_better(ours, theirs)}", _verdict(true))


def _only_whole_body(evidence: Evidence, scenario: str, title: str) -> Claim:
    ours = evidence.of(scenario, WHOLE_BODY)
    theirs = evidence.of(scenario, TUNED)
    stock = evidence.of(scenario, STOCK)
    statement = f"{title}: whole-body stays up, ZMP falls"
    parts = [_ups(WHOLE_BODY, ours), _ups(TUNED, theirs)]
    if stock is not None:
        parts.append(_ups(STOCK, stock))
    if ours is None or theirs is None:
        return Claim(statement, "; ".join(parts), OPEN)
    if ours.up and theirs.up:
        parts.append(_better(ours, theirs))
    true = ours.up == ours.runs and theirs.up == 0
    return Claim(statement, "; ".join(parts), _verdict(true))


def _limit_of(evidence: Evidence, variant: str, statement: str, *, at: float) -> Claim:
    """Judge the smallest 50 % limit with the ideal servo; report the slow one."""
    found = [_limits(evidence, variant, profile) for profile in PROFILES]
    ideal = found[PROFILES.index(IDEAL)]
    if not ideal:
        return Claim(statement, f"{variant}: not run", OPEN)
    told = []
    for profile, limits in zip(PROFILES, found, strict=True):
        each = ", ".join(f"{axis} {words}" for axis, (_, words) in limits.items())
        told.append(f"{profile} {each} deg/s" if each else f"{profile} not run")
    true = min(rate for rate, _ in ideal.values()) >= at
    return Claim(statement, f"half fall at: {'; '.join(told)}", _verdict(true))


def _limits(
    evidence: Evidence, variant: str, profile: str
) -> dict[str, tuple[float, str]]:
    """Return the rates at which half the runs fall [deg/s], by axis, also as text."""
    limits = {}
    for name in RAMPS:
        for curve in curves_over(evidence.summaries, scenario=name, name=TILT_RATE):
            if curve.label != f"{variant}, {profile}":
                continue
            axis = name.rsplit("-", 1)[1]
            lowest, highest = curve.levels[0], curve.levels[-1]
            if curve.limit is None:
                limits[axis] = (highest, f"over {highest:g}")
            elif curve.rates[0] < HALF:
                limits[axis] = (0.0, f"under {lowest:g}")
            else:
                limits[axis] = (curve.limit, f"{curve.limit:.0f}")
    return limits


def _share(evidence: Evidence, scenario: str, share: float, statement: str) -> Claim:
    found = evidence.of(scenario, WHOLE_BODY)
    return _many([] if found is None else [found], share, statement)


def _many(found: Iterable[GroupSummary], share: float, statement: str) -> Claim:
    found = list(found)
    up, runs = sum(s.up for s in found), sum(s.runs for s in found)
    if not runs:
        return Claim(statement, "-", OPEN)
    return Claim(statement, f"{up} of {runs} up", _verdict(up >= share * runs))


def _drop(evidence: Evidence) -> Claim:
    found = evidence.of("falling-platform-50", WHOLE_BODY)
    statement = f"50 mm drop: all up, contact regained in under {REGAIN_S:g} s"
    if found is None or found.contact_gap_s is None:
        return Claim(statement, "-", _verdict(None if found is None else False))
    true = found.up == found.runs and found.contact_gap_s < REGAIN_S
    words = f"{found.up} of {found.runs} up, at most {found.contact_gap_s:.3f} s"
    return Claim(statement, words, _verdict(true))


def _lower_everywhere(evidence: Evidence) -> Claim:
    statement = (
        f"Where both survive: horizontal CoM rms and force deviation {LOWER_BY:.0%} "
        f"lower than {TUNED} (both servo profiles)"
    )
    compared, short = 0, []
    for group, ours in evidence.summaries.items():
        theirs = evidence.summaries.get(group._replace(variant=TUNED))
        if group.variant != WHOLE_BODY or theirs is None:
            continue
        if ours.up < ours.runs or theirs.up < theirs.runs:
            continue
        compared += 1
        com = 1.0 - _ratio(ours.horizontal_mm, theirs.horizontal_mm)
        force = 1.0 - _ratio(ours.force_deviation_n, theirs.force_deviation_n)
        if min(com, force) < LOWER_BY:
            short.append(
                f"{group.case}, {group.servo_profile}: CoM {com:.0%}, force {force:.0%}"
            )
    if not compared:
        return Claim(statement, "-", OPEN)
    words = f"{compared - len(short)} of {compared} cases"
    if short:
        words += "; less in " + "; ".join(short)
    return Claim(statement, words, _verdict(not short))


def _ratio(ours: float | None, theirs: float | None) -> float:
    if not ours or not theirs:
        return 1.0
    return ours / theirs
