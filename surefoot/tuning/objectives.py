"""Objectives that a search minimises, and the runs that measure them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from surefoot.bench.bench_runs import Under, known_names
from surefoot.bench.sway_cells import AXES, CYCLE_S, START_S, TILTS, Stimulus, SwayCell
from surefoot.bench.sway_results import sway_result
from surefoot.robot_io.robot import load_robot
from surefoot.run_plan import RunPlan
from surefoot.schemas.motions import PrtsMotion
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.settings import ControllerSettings
from surefoot.signals import memory_sinks
from surefoot.simulation import Simulation
from surefoot.studies.cell import Cell, Row

EFFORT, SCORE, SENSITIVITY = "effort_w", "score", "sensitivity"
"""Extra figures of a row: mean absolute power of the joints [W]; COMTEST's distance D
from people; two over the disk margin of the loop."""
UNWALKED = "unwalked"
"""Key of a row whose walk was refused or had no step taken; its value is the reason."""
WORST_SENSITIVITY = 1e3
"""Sensitivity of an unstable loop, which has no margin."""
_LEAST_CYCLES = 3
BEYOND = 1e3
"""Figure of a trial whose runs ended before the figure counted: worse than that of any
trial that stands, in each unit."""


@dataclass(frozen=True)
class TuneCell(Cell):
    """A run of a search: a cell with extra figures.

    Attributes:
        extra: some of EFFORT, SCORE, SENSITIVITY.
    """

    extra: tuple[str, ...] = ()

    def run(self, plan: RunPlan) -> Row:
        """Run the plan; return the row: case and figures."""
        from surefoot.stabilizer.factory import make_controller

        sway = sway_of(plan) if SCORE in self.extra else None
        probe = None if sway is None else sway.probe()
        sinks = memory_sinks() if EFFORT in self.extra else None
        sim = Simulation.of_plan(plan, sinks=sinks)
        sim.goes_on = True
        controller = make_controller(plan.controller, plan.robot, plan.settings)
        sim.run(
            controller, on_tick=None if probe is None else lambda _: probe.look(sim)
        )
        row = self.row(sim.result())
        unwalked = _unwalked(plan, sim)
        if unwalked:
            row[UNWALKED] = unwalked
        if EFFORT in self.extra:
            power = abs(sim.signals["effort"] * sim.signals["dq"]).sum(axis=1)
            row[EFFORT] = float(power.mean())
        if sway is not None and probe is not None and succeeded(row):
            row[SCORE] = sway_result(sway, {**row, "seen": probe.figures()}).score
        if SENSITIVITY in self.extra:
            profile = plan.robot.file.servo.profile
            row[SENSITIVITY] = _sensitivity(
                str(plan.robot.path), profile, plan.settings
            )
        return row


def _unwalked(plan: RunPlan, sim: Simulation) -> str:
    """Why a walk was not walked; empty if it was, or if there was none.

    A robot that stands instead of walking would have the smallest errors.
    """
    controller = sim.sides().controller
    walk = None if controller is None else controller.walk
    if walk is None or plan.walk is None or not plan.walk.steps:
        return ""
    return walk.refusal or ("" if walk.steps_done else "no step was taken")


def sway_of(plan: RunPlan) -> SwayCell | None:
    """Return the COMTEST run that equals a scenario; None if there is none."""
    stimulus = stimulus_of(plan.scenario)
    if stimulus is None:
        return None
    return SwayCell(
        case=plan.scenario_name,
        scenario=plan.scenario,
        under=Under(plan.controller, plan.robot.file.servo.profile),
        stimulus=stimulus,
        height_m=1.0,  # without effect for a tilt
    )


def stimulus_of(scenario: Scenario) -> Stimulus | None:
    """Return a scenario's ternary tilt, if it is one on which people were measured.

    Returns:
        None unless the ground under both feet follows the sequence from 1 s on, about
        pitch or roll, at ordinary speed, for three or more complete cycles.
    """
    motions = [motion for platform in scenario.platform for motion in platform.motion]
    if len(motions) != 1 or scenario.platform[0].foot != "both":
        return None
    (motion,) = motions
    if not isinstance(motion, PrtsMotion):
        return None
    for axis in AXES:
        whole = START_S + motion.cycles * CYCLE_S <= scenario.duration_s
        fits = axis in TILTS and motion.axis == axis and motion.speed == 1.0 and whole
        if fits and motion.start_s == START_S and motion.cycles >= _LEAST_CYCLES:
            size = float(motion.peak_to_peak_deg or 0.0)
            return Stimulus("prts", axis, size, cycles=motion.cycles)
    return None


@lru_cache(maxsize=2)
def _sensitivity(robot: str, profile: str, settings: ControllerSettings) -> float:
    """Two over the disk margin; the same for all runs of a trial."""
    from surefoot.stabilizer.margins.margins import compute_margins

    margins = compute_margins(load_robot(robot, servo_profile=profile), settings)
    if not margins.stable or margins.disk <= 0.0:
        return WORST_SENSITIVITY
    return min(WORST_SENSITIVITY, 2.0 / margins.disk)


class Objective(NamedTuple):
    """A figure of a run.

    Attributes:
        name: as on the command line.
        unit: of the figure.
        about: description.
        of: takes the figure from a row; gives None if the run ended before it counted
            or has no such figure.
        extra: extra figure that a run has to measure; empty if none.
    """

    name: str
    unit: str
    about: str
    of: Callable[[Row], float | None]
    extra: str = ""


def _norm(name: str, *, mean: bool = False) -> Callable[[Row], float | None]:
    def of(row: Row) -> float | None:
        values = row[name]
        if values is None:
            return None
        return math.hypot(*values) / (math.sqrt(len(values)) if mean else 1.0)

    return of


def _largest(name: str) -> Callable[[Row], float | None]:
    return lambda row: None if row[name] is None else float(max(row[name]))


def _extra(name: str) -> Callable[[Row], float | None]:
    return lambda row: row.get(name)


_ALL = (
    Objective("com", "mm", "CoM error, rms of its length", _norm("com_error_rms_mm")),
    Objective(
        "com-max",
        "mm",
        "largest CoM errors along x, y, z, as a length",
        _norm("com_error_max_mm"),
    ),
    Objective(
        "force",
        "N",
        "force deviation, rms of both feet",
        _norm("force_deviation_rms_n", mean=True),
    ),
    Objective("peak", "N", "largest force on a foot", _largest("force_peak_n")),
    Objective("tilt", "deg", "largest tilt", lambda row: row["base_tilt_max_deg"]),
    Objective("dcm", "mm", "DCM error of a walk, rms", _norm("dcm_error_rms_mm")),
    Objective("effort", "W", "mean power of the joints", _extra(EFFORT), EFFORT),
    Objective("score", "", "D of COMTEST against people", _extra(SCORE), SCORE),
    Objective(
        "margin",
        "",
        "two over the loop's disk margin, 1 is best",
        _extra(SENSITIVITY),
        SENSITIVITY,
    ),
)
OBJECTIVES = {objective.name: objective for objective in _ALL}


def find_objectives(names: Sequence[str]) -> list[Objective]:
    """Return objectives by name.

    Raises:
        UsageError: there is no such objective, or one is named twice.
    """
    known = known_names(names, list(OBJECTIVES), what="--objectives")
    return [OBJECTIVES[name] for name in known]


def succeeded(row: Row) -> bool:
    """Return whether the robot was up at the end, and walked if it had a walk."""
    return Outcome(row["outcome"]).is_up and UNWALKED not in row


def mean_figures(rows: Sequence[Row], objectives: Sequence[Objective]) -> list[float]:
    """Return each objective's mean over the runs that have a figure for it."""

    def mean(objective: Objective) -> float:
        found = [value for row in rows if (value := objective.of(row)) is not None]
        return sum(found) / len(found) if found else BEYOND

    return [mean(objective) for objective in objectives]


def is_beaten(
    rows: Sequence[Row], by: Sequence[Row], objectives: Sequence[Objective]
) -> bool:
    """Return whether a trial was worse than another in every run and objective.

    Args:
        rows: runs of the trial so far.
        by: runs of the other, of the same cases in the same order.
        objectives: the objectives.
    """
    pairs = [
        (objective.of(row), objective.of(other))
        for row, other in zip(rows, by, strict=False)
        for objective in objectives
    ]
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    return bool(both) and all(a > b for a, b in both)
