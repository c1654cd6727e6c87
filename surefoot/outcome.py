"""Outcome of a run: one word, its time and reason, and all figures.

The rules are tried in this order; the first that holds decides:

1. **fell**, by the simulator's criterion.
2. **interrupted**: robot or stabilizer were asked to end before the run was over.
3. **not_controlled**: nobody took command; or nobody answered; or the QP was not solved
   in more than half of the ticks after the calibration, so that the posture was only
   kept; or the robot refused commands in more than half of its ticks.
4. **fault**: the robot's gate ended in FAULT.
5. **held**: the gate ended in HOLD or OFF, or the stabilizer had given up.
6. **walked**: the robot was given steps, has taken all of them, and stands.
7. **stood**.

In real time a slow machine counts as the cause of a fall, a hold or a fault if the gate
found the loop too slow, or if more than 5 % of the commands due before it came late or
not at all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import EndReason, ModeCause, Outcome, in_words, plain
from surefoot.schemas.result import (
    NO_TIME,
    ControllerResult,
    PlantResult,
    RelayResult,
    RunResult,
    WalkReport,
)

if TYPE_CHECKING:
    from surefoot.run_plan import RunPlan

LARGEST_UNSOLVED_SHARE = 0.5
"""Share of ticks without a solved QP, above which nobody was in control."""
LATE_SHARE = 0.05
"""Share of late commands above which a slow machine is the cause of a failure."""
_TO_THE_END = (EndReason.NONE, EndReason.RUN_OVER)
_ITS_COMMANDERS = (ModeCause.REQUESTED, ModeCause.RELEASED)
"""Causes of a hold that the stabilizer asked for; it knows the reason."""


class Judgement(NamedTuple):
    """How a run went."""

    outcome: Outcome
    detail: str

    @property
    def sentence(self) -> str:
        """Outcome and detail as text: ``fell at 1.40 s: the base leans by 61 deg``."""
        return f"{plain(self.outcome)} {self.detail}"


def judge(
    plant: PlantResult,
    controller: ControllerResult | None = None,
    *,
    is_realtime: bool = False,
    period_s: float,
) -> Judgement:
    """Judge a run by the rules at the top of this module.

    Args:
        plant: figures of the robot's side.
        controller: figures of the stabilizer's side; None if only the robot is known.
        is_realtime: whether the run was in real time, where a machine can be too slow.
        period_s: of the robot's ticks [s].
    """
    slow = _slow_machine(plant, period_s=period_s) if is_realtime else ""
    if plant.fell:
        return Judgement(Outcome.FELL, _fall(plant, controller, slow))
    stopped = _stopped(plant, controller)
    if stopped is not None:
        detail = f"at {plant.duration_s:g} s: {stopped}"
        return Judgement(Outcome.INTERRUPTED, detail)
    idle = _idle(plant, controller)
    if idle:
        detail = f"for {plant.duration_s:g} s: {idle}"
        return Judgement(Outcome.NOT_CONTROLLED, detail)
    gate = plant.gate
    if gate.mode is RobotMode.FAULT:
        detail = _since(gate.since_s, slow or in_words(gate.cause, gate.detail))
        return Judgement(Outcome.FAULT, detail)
    if gate.mode is not RobotMode.ACTIVE or _given_up(controller):
        return Judgement(Outcome.HELD, _hold(plant, controller, slow))
    return _up(plant, None if controller is None else controller.walk)


def _up(plant: PlantResult, walk: WalkReport | None) -> Judgement:
    """Whether it stood, or walked all its steps."""
    detail = f"{plant.duration_s:g} s"
    if walk is None:
        return Judgement(Outcome.STOOD, detail)
    done, planned = walk.steps_done, walk.steps_planned
    if walk.is_over and done == planned > 0 and not walk.refusal:
        far = "" if plant.distance_m is None else f", {plant.distance_m:.2f} m"
        steps = "1 step" if done == 1 else f"{done} steps"
        return Judgement(Outcome.WALKED, f"{steps}{far}, {detail}")
    why = walk.refusal or _unfinished(walk)
    return Judgement(Outcome.STOOD, f"{detail}, {done} of {planned} steps taken: {why}")


def _unfinished(walk: WalkReport) -> str:
    """The missing part of a walk in which no plan was refused."""
    if not walk.steps_planned:
        return "there was no time for a step, or none was planned"
    if not walk.is_over:
        return "still walking at the end"
    if not walk.steps_done:
        return "no step was begun: it was not time yet, or a foot had no ground"
    return "the rest was not begun"


def _fall(plant: PlantResult, controller: ControllerResult | None, slow: str) -> str:
    """Time of the fall, the criterion, and the faults before it."""
    gate = plant.gate
    before = ""
    if gate.mode is not RobotMode.ACTIVE:
        why = in_words(gate.cause, gate.detail)
        if gate.cause in _ITS_COMMANDERS:
            why = _given_up(controller) or why
        before = f"; {gate.mode} since {gate.since_s:.2f} s, {why}"
    what = f"{slow}; {plant.fall_detail}" if slow else plant.fall_detail
    return f"at {plant.fell_at_s:.2f} s: {what}{before}"


def _stopped(plant: PlantResult, controller: ControllerResult | None) -> str | None:
    """Who asked the run to end early; None when nobody did."""
    if plant.end is ModeCause.STOPPED:
        return plant.end_detail
    if controller is not None and controller.end is EndReason.STOPPED:
        return f"the stabilizer, {controller.end_detail}"
    return None


def _idle(plant: PlantResult, controller: ControllerResult | None) -> str:
    """Why nobody controlled the robot; empty if somebody did."""
    if plant.end is ModeCause.NO_COMMANDER:
        return plant.end_detail
    refused = sum(plant.refused.values())
    if refused > LARGEST_UNSOLVED_SHARE * plant.ticks:
        most = max(plant.refused, key=lambda name: plant.refused[name])
        return f"the robot refused {refused} commands in {plant.ticks} ticks ({most})"
    if controller is None:
        return ""
    if controller.ticks == 0:
        return f"the stabilizer answered none of {plant.ticks} ticks"
    failed, of = controller.balancing_failures, controller.balancing_ticks
    if failed > LARGEST_UNSOLVED_SHARE * of:
        return f"no solution of the QPs in {failed} of {of} ticks"
    return ""


def _hold(plant: PlantResult, controller: ControllerResult | None, slow: str) -> str:
    gate = plant.gate
    if slow:
        return _since(gate.since_s, slow)
    why = _given_up(controller) or in_words(gate.cause, gate.detail)
    if gate.mode is RobotMode.ACTIVE:
        return f"at the end: {why}"
    return _since(gate.since_s, why)


def _given_up(controller: ControllerResult | None) -> str:
    """Why the stabilizer gave up, in words; empty if it went on or is not known."""
    if controller is None or controller.end in _TO_THE_END:
        return ""
    return in_words(controller.end, controller.end_detail)


def _since(time_s: float, why: str) -> str:
    return f"since {time_s:.2f} s: {why}"


def _slow_machine(plant: PlantResult, *, period_s: float) -> str:
    """Why the machine was too slow, in words; empty when it was not."""
    gate = plant.gate
    is_active = gate.mode is RobotMode.ACTIVE
    commanded_s = plant.duration_s if is_active else gate.since_s
    share = plant.deadline_misses * period_s / max(commanded_s, period_s)
    if gate.cause is ModeCause.LOOP_TOO_SLOW or share > LATE_SHARE:
        return f"machine too slow: {100.0 * min(share, 1.0):.0f} % of commands late"
    return ""


class Sides(NamedTuple):
    """Figures of both sides of a run.

    Attributes:
        plant: the robot's.
        controller: the stabilizer's; None when its process left nothing.
        relay: those of the relay between them; None without one.
    """

    plant: PlantResult
    controller: ControllerResult | None
    relay: RelayResult | None = None


_NOTHING = ControllerResult(
    ticks=0,
    tick_ms=NO_TIME,
    force_error_rms_n=None,
    qp_failures=0,
    stale_snapshots=0,
    degraded_ticks=0,
    lost_sensors={},
    balancing_ticks=0,
    balancing_failures=0,
    end=EndReason.NONE,
    end_detail="its process ended and left no figures",
)
"""Figures of a stabilizer whose process died."""


def join_result(plan: RunPlan, sides: Sides) -> RunResult:
    """Join both sides of a run into its result, the object that scripts read."""
    plant, answered, relay = sides
    outcome, detail = judge(
        plant,
        answered,
        is_realtime=plan.mode == "realtime",
        period_s=plan.robot.period_s,
    )
    controller = answered or _NOTHING
    measured = [side for side in (controller.walk, controller, plant) if side]
    figures: dict[str, Any] = {  # both sides have some names: the plant's figure counts
        name: getattr(side, name)
        for side in measured
        for name in set(RunResult.__struct_fields__) & set(side.__struct_fields__)
    }
    figures |= {
        "end": controller.end,
        "end_detail": controller.end_detail,
        "histograms": {**plant.histograms, **controller.histograms},
        "unrecorded_ticks": max(plant.unrecorded_ticks, controller.unrecorded_ticks),
    }
    return RunResult(
        scenario=plan.scenario_name,
        controller=plan.controller,
        robot=plan.robot.file.name,
        seed=plan.seed,
        mode=plan.mode,
        outcome=outcome,
        outcome_detail=detail,
        out=None,
        relay=relay,
        **figures,
    )
