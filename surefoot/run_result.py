"""What the two sides of a run measured, joined into the object scripts read."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from surefoot.outcome import judge
from surefoot.run_plan import RunPlan
from surefoot.schemas.reasons import EndReason
from surefoot.schemas.result import (
    ControllerResult,
    Distribution,
    PlantResult,
    RelayResult,
    RunResult,
)


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
    tick_ms=Distribution(median=0.0, p99=0.0, max=0.0),
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


def join_result(plan: RunPlan, sides: Sides, *, out: Path | None = None) -> RunResult:
    """Join both sides of a run into the object scripts read.

    Args:
        plan: what was run.
        sides: what was measured.
        out: folder of the run, if it is kept.
    """
    plant, answered, relay = sides
    outcome, detail = judge(
        plant,
        answered,
        is_realtime=plan.mode == "realtime",
        period_s=plan.robot.period_s,
    )
    controller = answered or _NOTHING
    walk = controller.walk
    return RunResult(
        scenario=plan.scenario_name,
        controller=plan.controller,
        robot=plan.robot.file.name,
        seed=plan.seed,
        mode=plan.mode,
        outcome=outcome,
        outcome_detail=detail,
        fell=plant.fell,
        fell_at_s=plant.fell_at_s,
        duration_s=plant.duration_s,
        com_error_rms_mm=plant.com_error_rms_mm,
        com_error_max_mm=plant.com_error_max_mm,
        base_tilt_max_deg=plant.base_tilt_max_deg,
        force_error_rms_n=controller.force_error_rms_n,
        force_deviation_rms_n=plant.force_deviation_rms_n,
        force_peak_n=plant.force_peak_n,
        contact_lost_s=plant.contact_lost_s,
        contact_gap_s=plant.contact_gap_s,
        real_time_factor=plant.real_time_factor,
        tick_ms=controller.tick_ms,
        round_trip_ms=plant.round_trip_ms,
        period_jitter_ms=plant.period_jitter_ms,
        deadline_misses=plant.deadline_misses,
        qp_failures=controller.qp_failures,
        degraded_ticks=controller.degraded_ticks,
        lost_sensors=controller.lost_sensors,
        end=controller.end,
        end_detail=controller.end_detail,
        refused=plant.refused,
        clipped=plant.clipped,
        ticks=plant.ticks,
        log_sha256=plant.log_sha256,
        out=None if out is None else str(out),
        pushes=plant.pushes,
        recorded_ground=plant.recorded_ground,
        settings_changes=controller.settings_changes,
        end_to_end_ms=plant.end_to_end_ms,
        skipped_ticks=controller.skipped_ticks,
        slow_ticks=controller.slow_ticks,
        histograms={**plant.histograms, **controller.histograms},
        relay=relay,
        unrecorded_ticks=max(plant.unrecorded_ticks, controller.unrecorded_ticks),
        steps_done=None if walk is None else walk.steps_done,
        steps_planned=None if walk is None else walk.steps_planned,
        distance_m=plant.distance_m,
        dcm_error_rms_mm=None if walk is None else walk.dcm_error_rms_mm,
        dcm_error_max_mm=None if walk is None else walk.dcm_error_max_mm,
        placement_error_max_mm=None if walk is None else walk.placement_error_max_mm,
        touchdown_peak_n=plant.touchdown_peak_n,
    )
