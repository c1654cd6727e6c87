"""A run of a trial: a study's, with figures that only a search asks for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from surefoot.bench.bench_cell import Under
from surefoot.bench.sway_cells import AXES, CYCLE_S, START_S, TILTS, Stimulus, SwayCell
from surefoot.bench.sway_results import sway_result
from surefoot.robot_io.robot import load_robot
from surefoot.run_plan import RunPlan
from surefoot.schemas.motions import PrtsMotion
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.settings import ControllerSettings
from surefoot.signals import memory_sinks
from surefoot.simulation import Simulation
from surefoot.studies.cell import Cell, Row

EFFORT, SCORE, SENSITIVITY = "effort_w", "score", "sensitivity"
"""What a row may have besides: the joints' mean power, be it done or taken up [W]; D of
COMTEST against people; two over the loop's disk margin."""
WORST_SENSITIVITY = 1e3
"""Of a loop that sways by itself, which has no margin."""
_LEAST_CYCLES = 3


@dataclass(frozen=True)
class TuneCell(Cell):
    """What is run, with which seed, and what is looked for besides.

    Attributes:
        extra: some of EFFORT, SCORE, SENSITIVITY.
    """

    extra: tuple[str, ...] = ()

    def run(self, plan: RunPlan) -> Row:
        """Run its plan; what was run, and the figures."""
        from surefoot.stabilizer.factory import make_controller

        sway = sway_of(plan) if SCORE in self.extra else None
        probe = None if sway is None else sway.probe()
        sinks = memory_sinks() if EFFORT in self.extra else None
        sim = Simulation.of_plan(plan, sinks=sinks)
        controller = make_controller(plan.controller, plan.robot, plan.settings)
        sim.run(
            controller, on_tick=None if probe is None else lambda _: probe.look(sim)
        )
        row = self.row(sim.result())
        if EFFORT in self.extra:
            power = abs(sim.signals["effort"] * sim.signals["dq"]).sum(axis=1)
            row[EFFORT] = float(power.mean())
        if sway is not None and probe is not None:
            row[SCORE] = sway_result(sway, {**row, "seen": probe.figures()}).score
        if SENSITIVITY in self.extra:
            profile = plan.robot.file.servo.profile
            row[SENSITIVITY] = _sensitivity(
                str(plan.robot.path), profile, plan.settings
            )
        return row


def sway_of(plan: RunPlan) -> SwayCell | None:
    """Return COMTEST's run that a scenario is; None for another scenario."""
    stimulus = stimulus_of(plan.scenario)
    if stimulus is None:
        return None
    return SwayCell(
        case=plan.scenario_name,
        scenario=plan.scenario,
        under=Under(plan.controller, plan.robot.file.servo.profile),
        stimulus=stimulus,
        height_m=1.0,  # of no account for a tilt
    )


def stimulus_of(scenario: Scenario) -> Stimulus | None:
    """Return the ternary tilt that a scenario is made of, as people stood on it.

    Returns:
        None unless its ground under both feet follows the sequence from 1 s on, about
        pitch or roll, at its ordinary speed, for three cycles or more, to their end.
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
