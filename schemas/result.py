"""Results of a run: the object printed by ``surefoot run --json``."""

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
    """Histogram of a time."""

    edges_ms: list[float]
    """Edges of the bins, rising [ms]."""
    counts: list[int]
    """Counts, one more than edges: below the first edge, between edges, above the
    last."""


NO_TIME = Distribution(median=0.0, p99=0.0, max=0.0)


class ModeReport(msgspec.Struct, frozen=True, kw_only=True):
    """State of the robot's gate when its run ended."""

    mode: RobotMode
    """Mode of the gate."""
    cause: ModeCause
    """Why the gate was in this mode."""
    detail: str
    """The same in words."""
    since_s: float
    """Time since which it was in this mode [s]."""


COMMANDED = ModeReport(
    mode=RobotMode.ACTIVE, cause=ModeCause.REQUESTED, detail="", since_s=0.0
)
"""Report of a robot that was commanded to the end."""


class RecordedGround(msgspec.Struct, frozen=True, kw_only=True):
    """A recorded motion that the ground followed."""

    file: str
    """Name of the file, without its folder."""
    sha256: str
    """Digest of the file's content."""
    platform: int
    """Number of the platform in the scenario, from 0."""
    axis: str
    """Axis along or about which the platform moved."""
    stroke: float
    """Distance from the lowest to the highest place [m, or deg for tilts]."""
    speed_max: float
    """Largest speed [m/s or deg/s]."""
    acceleration_max: float
    """Largest acceleration [m/s^2 or deg/s^2]."""


class WalkReport(msgspec.Struct, frozen=True, kw_only=True):
    """A walk, as the stabilizer estimates it."""

    steps_done: int
    """Planned steps that were set down, without the one that brings the feet
    together."""
    steps_planned: int
    """Steps of all accepted plans."""
    is_over: bool
    """Whether the robot has come to stand after its steps."""
    dcm_error_rms_mm: Pair
    """DCM against its reference, x and y: root mean square over the walk."""
    dcm_error_max_mm: Pair
    """The same: largest."""
    placement_error_max_mm: float
    """Largest distance of a foothold from its goal, shifts by step adjustment
    included."""
    touchdown_late_s: Pair
    """Earliest and latest touchdown against the adjusted plan; negative is early."""
    refusal: str = ""
    """Why the last plan was refused, in words; empty when it was accepted."""


class PlantResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the simulated robot measured of its own truth.

    CoM errors count from 1 s on: x and y against the reference offset from the midpoint
    of the true soles, z against the reference height in the world. Fields without a
    text here are those of :class:`RunResult`.
    """

    fell: bool
    fell_at_s: float | None
    fall: FallCriterion | None
    """Criterion that detected the fall; None without a fall."""
    fall_detail: str
    """The same in words, with the link or the figure; empty without a fall."""
    end: ModeCause
    """Why the run ended."""
    end_detail: str
    """The same in words; may be empty."""
    gate: ModeReport
    """State of the robot's gate at the end."""
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
    """Distance that the middle of the true soles has moved in a walk; else None."""
    touchdown_peak_n: Pair | None = None
    """Largest true normal force within 0.1 s of a touchdown, in a walk; else None."""

    @property
    def is_walk(self) -> bool:
        """Whether the scenario is a walk; single steps are not known here."""
        return self.distance_m is not None


class ControllerResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the stabilizer measured of itself; other fields as in :class:`RunResult`."""

    ticks: int
    tick_ms: Distribution
    force_error_rms_n: Pair | None
    qp_failures: int
    stale_snapshots: int
    degraded_ticks: int
    lost_sensors: dict[str, SensorTrouble]
    balancing_ticks: int
    """Ticks answered after the calibration at the start."""
    balancing_failures: int
    """Ticks among them whose QPs were not solved."""
    end: EndReason
    """Why it ended."""
    end_detail: str
    """The same in words; may be empty."""
    settings_changes: list[SettingsChange] = []
    skipped_ticks: int = 0
    slow_ticks: int = 0
    restarts: int = 0
    """Restarts from a held posture: after a hold, or when the robot came back."""
    histograms: dict[str, Histogram] = {}
    unrecorded_ticks: int = 0
    walk: WalkReport | None = None
    """Report of the walk; None without steps."""


class RelayResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a relay did to the messages between robot and stabilizer."""

    plan: str
    """Name of the plan."""
    counts: dict[str, dict[str, int]]
    """By channel: messages that ``arrived`` and ``left``, and how many each kind of
    fault has changed."""


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """Results of one whole run."""

    scenario: str
    """Name of the scenario."""
    controller: str
    """Name of the controller."""
    robot: str
    """Name of the robot."""
    seed: int
    """Seed of the sensor noise."""
    mode: Literal["lockstep", "realtime", "inline"]
    """How robot and controller were connected and timed."""
    outcome: Outcome
    """How the run went; only ``stood`` and ``walked`` are successes."""
    outcome_detail: str
    """When and why, in words."""
    fell: bool
    """Whether the robot fell."""
    fell_at_s: float | None
    """Time of the fall; null without a fall."""
    duration_s: float
    """Simulated time, to the end or the fall."""
    com_error_rms_mm: Floats3 | None
    """True CoM against its reference, x y z, from 1 s on: root mean square. Null for a
    run that ended within its first second, like all figures that count from there."""
    com_error_max_mm: Floats3 | None
    """The same: largest."""
    base_tilt_max_deg: float
    """Largest tilt of the base from upright."""
    force_error_rms_n: Pair | None
    """Measured against desired normal force, left and right; null if none was
    desired."""
    force_deviation_rms_n: Pair | None
    """True vertical force against half the robot's weight, left and right."""
    force_peak_n: Pair | None
    """Largest true normal force from 0.2 s on, left and right. Null for a run that
    ended before."""
    contact_lost_s: Pair
    """Total time without ground contact, left and right."""
    contact_gap_s: Pair
    """Longest uninterrupted time without ground contact, left and right."""
    real_time_factor: float
    """Simulated time divided by the time taken."""
    tick_ms: Distribution
    """Stabilizer's time from snapshot to command."""
    round_trip_ms: Distribution
    """Time from sensors sent to command received, per tick."""
    period_jitter_ms: Distribution
    """Real time only: how late each tick began; zero in lockstep."""
    deadline_misses: int
    """Ticks that went on without their command."""
    qp_failures: int
    """Ticks whose QPs were not solved; the posture was held."""
    degraded_ticks: int
    """Ticks answered without some sensor, or while giving up."""
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
    """Time from the sensors' stamp to the command applied, on the robot's side."""
    skipped_ticks: int = 0
    """Ticks of the robot that got no answer, in real time."""
    slow_ticks: int = 0
    """Answers that took longer than a period to compute."""
    histograms: dict[str, Histogram] = {}
    """Times of both sides, when asked for."""
    unrecorded_ticks: int = 0
    """Ticks missing from a ticks file because the disk was too slow or full."""
    relay: RelayResult | None = None
    """What a relay did to the messages, if there was one."""
    steps_done: int | None = None
    """Steps of the walk that were set down; null without a walk, like all fields
    below."""
    steps_planned: int | None = None
    """Steps that were planned."""
    distance_m: float | None = None
    """True distance that the middle of the soles has moved."""
    dcm_error_rms_mm: Pair | None = None
    """Estimated DCM against its reference, x and y: root mean square over the walk."""
    dcm_error_max_mm: Pair | None = None
    """The same: largest."""
    placement_error_max_mm: float | None = None
    """Largest estimated distance of a foothold from its goal, shifts included."""
    touchdown_peak_n: Pair | None = None
    """Largest true normal force within 0.1 s of a touchdown, left and right."""

    @property
    def has_walked(self) -> bool:
        """Whether a step was set down.

        CoM errors against the middle of the feet, and figures on the contact of both
        feet, mean little then.
        """
        return bool(self.steps_done)
