"""How a run went: one word with when and why, and all its figures.

The rules, in this order; the first that holds decides:

1. **fell**, by the simulator's criterion.
2. **interrupted**: robot or stabilizer were asked to end before the run was over.
3. **not_controlled**: nobody took command; or nobody answered; or of the ticks after
   the calibration more than half had a QP that was not solved, so that the posture was
   only kept; or the robot refused commands in more than half of its ticks.
4. **fault**: the robot's gate ended in FAULT.
5. **held**: the gate ended in HOLD or OFF, or the stabilizer had given up.
6. **walked**: it was given steps, has taken all of them, and stands.
7. **stood**.

In real time a fall, a hold or a fault is put down to the machine when the gate found
the loop too slow, or when more than 5 % of the commands that were due before came late
or not at all.
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
"""Share of ticks in which nothing was balanced, above which nobody was in control."""
LATE_SHARE = 0.05
"""Share of late commands, above which a slow machine is the cause of a failure."""
_TO_THE_END = (EndReason.NONE, EndReason.RUN_OVER)
_ITS_COMMANDERS = (ModeCause.REQUESTED, ModeCause.RELEASED)
"""Why a gate holds: the stabilizer had it so, and knows why."""


class Judgement(NamedTuple):
    """How a run went."""

    outcome: Outcome
    detail: str

    @property
    def sentence(self) -> str:
        """Both, for people: ``fell at 1.40 s: the base leans by 61 deg``."""
        return f"{plain(self.outcome)} {self.detail}"


def judge(
    plant: PlantResult,
    controller: ControllerResult | None = None,
    *,
    is_realtime: bool = False,
    period_s: float,
) -> Judgement:
    """Say how a run went, by the rules at the top.

    Args:
        plant: what the robot measured.
        controller: what the stabilizer measured; None where only the robot is known.
        is_realtime: whether time went by the clock, so that a machine can be too slow.
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
    """Whether it stood, or walked all the way that it was to walk."""
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
    """What is missing of a walk that no plan was refused in."""
    if not walk.steps_planned:
        return "there was no time for a step, or none was planned"
    if not walk.is_over:
        return "still walking at the end"
    if not walk.steps_done:
        return "no step was begun: it was not time yet, or a foot had no ground"
    return "the rest was not begun"


def _fall(plant: PlantResult, controller: ControllerResult | None, slow: str) -> str:
    """When it fell and how one knows; what had gone wrong before."""
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
    """Who asked the run to end before its time; None when nobody did."""
    if plant.end is ModeCause.STOPPED:
        return plant.end_detail
    if controller is not None and controller.end is EndReason.STOPPED:
        return f"the stabilizer, {controller.end_detail}"
    return None


def _idle(plant: PlantResult, controller: ControllerResult | None) -> str:
    """Why nobody can be said to have controlled the robot; empty if somebody did."""
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
    """Why the stabilizer did, in words; empty when it went on, or is not known."""
    if controller is None or controller.end in _TO_THE_END:
        return ""
    return in_words(controller.end, controller.end_detail)


def _since(time_s: float, why: str) -> str:
    return f"since {time_s:.2f} s: {why}"


def _slow_machine(plant: PlantResult, *, period_s: float) -> str:
    """That the machine was the cause, in words; empty when it was not."""
    gate = plant.gate
    is_active = gate.mode is RobotMode.ACTIVE
    commanded_s = plant.duration_s if is_active else gate.since_s
    share = plant.deadline_misses * period_s / max(commanded_s, period_s)
    if gate.cause is ModeCause.LOOP_TOO_SLOW or share > LATE_SHARE:
        return f"machine too slow: {100.0 * min(share, 1.0):.0f} % of commands late"
    return ""


class Sides(NamedTuple):
    """What the two sides of a run measured.

    Attributes:
        plant: the robot's side.
        controller: the stabilizer's; None when its process left nothing.
        relay: of the relay between them, if there was one.
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
    """Join both sides of a run into the object scripts read."""
    plant, answered, relay = sides
    outcome, detail = judge(
        plant,
        answered,
        is_realtime=plan.mode == "realtime",
        period_s=plan.robot.period_s,
    )
    controller = answered or _NOTHING
    measured = [side for side in (controller.walk, controller, plant) if side]
    figures: dict[str, Any] = {  # of a name that both sides have, the plant's
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
