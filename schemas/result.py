"""What a run reports: the object of ``surefoot run --json``."""

from __future__ import annotations

from typing import Literal

import msgspec

from surefoot.schemas.arrays import Floats3, Pair
from surefoot.schemas.messages import PushEvent, RobotMode, SettingsChange
from surefoot.schemas.reasons import (
    EndReason,
    FallCriterion,
    ModeCause,
    Outcome,
    SensorTrouble,
)


class Distribution(msgspec.Struct, frozen=True, kw_only=True):
    """Median, 99th percentile and maximum of a time [ms]."""

    median: float
    """Half of all are below it [ms]."""
    p99: float
    """All but one in a hundred are below it [ms]."""
    max: float
    """The largest [ms]."""


class Histogram(msgspec.Struct, frozen=True, kw_only=True):
    """How often a time was between two edges."""

    edges_ms: list[float]
    """Rising [ms]."""
    counts: list[int]
    """One more than edges: below the first one, between them, above the last."""


NO_TIME = Distribution(median=0.0, p99=0.0, max=0.0)


class ModeReport(msgspec.Struct, frozen=True, kw_only=True):
    """What the robot's gate was doing when its run ended."""

    mode: RobotMode
    """Its mode."""
    cause: ModeCause
    """Why it was in it."""
    detail: str
    """The same in words."""
    since_s: float
    """Since when [s]."""


COMMANDED = ModeReport(
    mode=RobotMode.ACTIVE, cause=ModeCause.REQUESTED, detail="", since_s=0.0
)
"""Of a robot that was commanded to the end."""


class RecordedGround(msgspec.Struct, frozen=True, kw_only=True):
    """A recorded motion that the ground followed."""

    file: str
    """Its name, without the folder."""
    sha256: str
    """Of the file's content."""
    platform: int
    """Which platform of the scenario, from 0."""
    axis: str
    """Along or about which axis."""
    stroke: float
    """From the lowest to the highest place [m, or deg for tilts]."""
    speed_max: float
    """The largest [m/s or deg/s]."""
    acceleration_max: float
    """The largest [m/s^2 or deg/s^2]."""


class WalkReport(msgspec.Struct, frozen=True, kw_only=True):
    """A walk, as the stabilizer knows it."""

    steps_done: int
    """Steps of plans that were set down; bringing the feet together is none."""
    steps_planned: int
    """Steps of the plans that were taken."""
    is_over: bool
    """Whether the robot has come to stand after them."""
    dcm_error_rms_mm: Pair
    """Divergent component of motion against its reference, x and y: root mean square
    over the walk."""
    dcm_error_max_mm: Pair
    """The same: largest."""
    placement_error_max_mm: float
    """Farthest that a foot was set from where it was meant."""
    touchdown_late_s: Pair
    """Earliest and latest touchdown against plan, negative when early."""
    refusal: str = ""
    """Why the last plan was refused, in words; empty when it was taken."""


class PlantResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the simulated robot measured of its own truth.

    CoM errors count from 1 s on: x and y against the reference offset from the
    midpoint of the true soles, z against the reference height in the world. Figures
    without a word are those of :class:`RunResult`.
    """

    fell: bool
    fell_at_s: float | None
    fall: FallCriterion | None
    """By which criterion; None when it did not."""
    fall_detail: str
    """The same in words, with the link or the figure; empty when it did not."""
    end: ModeCause
    """Why the run ended."""
    end_detail: str
    """The same in words; may be empty."""
    gate: ModeReport
    """What the robot's gate was doing at the end."""
    duration_s: float
    com_error_rms_mm: Floats3 | None
    com_error_max_mm: Floats3 | None
    base_tilt_max_deg: float
    force_deviation_rms_n: Pair | None
    force_peak_n: Pair | None
    contact_lost_s: Pair
    contact_gap_s: Pair
    real_time_factor: float
    round_trip_ms: Distribution
    period_jitter_ms: Distribution
    deadline_misses: int
    ticks: int
    refused: dict[str, int]
    clipped: dict[str, int]
    log_sha256: str
    pushes: list[PushEvent] = []
    recorded_ground: list[RecordedGround] = []
    end_to_end_ms: Distribution = NO_TIME
    histograms: dict[str, Histogram] = {}
    unrecorded_ticks: int = 0
    distance_m: float | None = None
    """How far the middle of the true soles has come, in a walk; else None."""
    touchdown_peak_n: Pair | None = None
    """Largest true normal force within 0.1 s of a touchdown, in a walk; else None."""

    @property
    def has_walked(self) -> bool:
        """Whether its scenario is a walk; it does not know of steps."""
        return self.distance_m is not None


class ControllerResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the stabilizer measured of itself; the rest is as in :class:`RunResult`."""

    ticks: int
    tick_ms: Distribution
    force_error_rms_n: Pair | None
    qp_failures: int
    stale_snapshots: int
    degraded_ticks: int
    lost_sensors: dict[str, SensorTrouble]
    balancing_ticks: int
    """Ticks answered after the calibration of its start."""
    balancing_failures: int
    """Those of them whose QPs were not solved."""
    end: EndReason
    """Why it ended."""
    end_detail: str
    """The same in words; may be empty."""
    settings_changes: list[SettingsChange] = []
    skipped_ticks: int = 0
    slow_ticks: int = 0
    restarts: int = 0
    """Times it began anew from a held posture: the robot came back, or had held."""
    histograms: dict[str, Histogram] = {}
    unrecorded_ticks: int = 0
    walk: WalkReport | None = None
    """Of a robot that was given steps; else None."""


class RelayResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a relay between the two did to their messages."""

    plan: str
    """Name of the plan."""
    counts: dict[str, dict[str, int]]
    """By channel: messages that ``arrived`` and ``left``, and how many each kind of
    fault did something to."""


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """One run, whole."""

    scenario: str
    """Its name."""
    controller: str
    """Which law."""
    robot: str
    """Which robot file."""
    seed: int
    """Of the sensor noise."""
    mode: Literal["lockstep", "realtime", "inline"]
    """How the two sides met."""
    outcome: Outcome
    """How it went; only ``stood`` and ``walked`` are successes."""
    outcome_detail: str
    """When and why, in words."""
    fell: bool
    """Whether the robot fell."""
    fell_at_s: float | None
    """When it did; null when it did not."""
    duration_s: float
    """Simulated time, to the end or the fall."""
    com_error_rms_mm: Floats3 | None
    """CoM against its reference, x y z, true, from 1 s on: root mean square. Null for
    a run that ended within its first second, like all that counts from there."""
    com_error_max_mm: Floats3 | None
    """The same: largest."""
    base_tilt_max_deg: float
    """Farthest the base leaned from upright."""
    force_error_rms_n: Pair | None
    """Measured against desired normal force, left and right; null when nobody did."""
    force_deviation_rms_n: Pair | None
    """True vertical force against half the robot's weight, left and right."""
    force_peak_n: Pair | None
    """Largest true normal force from 0.2 s on, left and right. Null for a run that
    ended before."""
    contact_lost_s: Pair
    """Time without the ground, left and right, all together."""
    contact_gap_s: Pair
    """Longest time at a stretch without the ground, left and right."""
    real_time_factor: float
    """Simulated time over time taken."""
    tick_ms: Distribution
    """Stabilizer's time from snapshot to command."""
    round_trip_ms: Distribution
    """Sensors sent to command received, per tick."""
    period_jitter_ms: Distribution
    """Real time only: how late each tick began; zero in lockstep."""
    deadline_misses: int
    """Ticks that went on without their command."""
    qp_failures: int
    """Ticks whose QPs were not solved; the posture was held."""
    degraded_ticks: int
    """Ticks answered without a sensor, or while giving up."""
    lost_sensors: dict[str, SensorTrouble]
    """Sensors that were lost at any time, by channel, and why at first."""
    end: EndReason
    """Why the stabilizer ended, or gave up."""
    end_detail: str
    """The same in words; may be empty."""
    refused: dict[str, int]
    """Commands the gate refused, by reason."""
    clipped: dict[str, int]
    """Commands the gate clipped, by limit."""
    ticks: int
    """Control ticks run."""
    log_sha256: str
    """Digest of every tick's sensors and commands."""
    out: str | None
    """Folder of the run; null when none was asked for."""
    pushes: list[PushEvent] = []
    """Pushes asked for during the run, besides the scenario's."""
    recorded_ground: list[RecordedGround] = []
    """Recorded motions of the scenario, as the ground did them."""
    settings_changes: list[SettingsChange] = []
    """Changes of settings during the run."""
    end_to_end_ms: Distribution = NO_TIME
    """Stamp of the sensors to command applied, on the robot's side."""
    skipped_ticks: int = 0
    """The robot's ticks that went by without an answer, in real time."""
    slow_ticks: int = 0
    """Answers that took longer than a period to compute."""
    histograms: dict[str, Histogram] = {}
    """Times of both sides, when asked for."""
    unrecorded_ticks: int = 0
    """Ticks that a ticks file lacks, since the disk was too slow, or full."""
    relay: RelayResult | None = None
    """What a relay did to the bus, if there was one."""
    steps_done: int | None = None
    """Steps of the walk that were set down; null without a walk, like all that
    follows."""
    steps_planned: int | None = None
    """Steps that were asked for."""
    distance_m: float | None = None
    """How far the middle of the soles has come, true."""
    dcm_error_rms_mm: Pair | None = None
    """Divergent component of motion against its reference, as estimated, x and y:
    root mean square over the walk."""
    dcm_error_max_mm: Pair | None = None
    """The same: largest."""
    placement_error_max_mm: float | None = None
    """Farthest that a foot was set from where it was meant, as estimated."""
    touchdown_peak_n: Pair | None = None
    """Largest true normal force within 0.1 s of a touchdown, left and right."""

    @property
    def has_walked(self) -> bool:
        """Whether a step was set down.

        CoM errors, against the middle of the feet, and what tells whether both feet
        stood mean little then.
        """
        return bool(self.steps_done)
