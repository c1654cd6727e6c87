"""What a run reports: the object of ``surefoot run --json``."""

from __future__ import annotations

from typing import Literal

import msgspec

from schemas.arrays import Floats3, Pair
from schemas.messages import PushEvent, SettingsChange


class Distribution(msgspec.Struct, frozen=True, kw_only=True):
    """Median, 99th percentile and maximum of a time [ms]."""

    median: float
    p99: float
    max: float


class PlantResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the simulated robot measured of its own truth.

    CoM errors count from 1 s on: x and y against the reference offset from the
    midpoint of the true soles, z against the reference height in the world.
    """

    fell: bool
    fell_at_s: float | None
    duration_s: float
    com_error_rms_mm: Floats3
    com_error_max_mm: Floats3
    base_tilt_max_deg: float
    force_deviation_rms_n: Pair
    """True normal force against half the robot's weight, left and right."""
    force_peak_n: Pair
    contact_lost_s: Pair
    contact_gap_s: Pair
    """Longest time at a stretch without the ground, left and right."""
    real_time_factor: float
    round_trip_ms: Distribution
    """Sensors sent to command received, per tick."""
    period_jitter_ms: Distribution
    """Real time only: how late each tick began; zero in lockstep."""
    deadline_misses: int
    ticks: int
    refused: dict[str, int]
    clipped: dict[str, int]
    log_sha256: str
    pushes: list[PushEvent] = []
    """Pushes asked for during the run, besides the scenario's."""


class ControllerResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the stabilizer measured of itself."""

    ticks: int
    tick_ms: Distribution
    force_error_rms_n: Pair
    """Measured against wanted normal force, left and right."""
    qp_failures: int
    stale_snapshots: int
    degraded_ticks: int
    """Ticks answered without a sensor, or while giving up."""
    reason: str
    """Why it ended."""
    settings_changes: list[SettingsChange] = []
    """Changes of settings during the run."""


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
    controller: str
    robot: str
    seed: int
    mode: Literal["lockstep", "realtime", "inline"]
    fell: bool
    fell_at_s: float | None
    duration_s: float
    com_error_rms_mm: Floats3
    com_error_max_mm: Floats3
    base_tilt_max_deg: float
    force_error_rms_n: Pair
    force_deviation_rms_n: Pair
    force_peak_n: Pair
    contact_lost_s: Pair
    contact_gap_s: Pair
    """Longest time at a stretch without the ground, left and right."""
    real_time_factor: float
    tick_ms: Distribution
    round_trip_ms: Distribution
    period_jitter_ms: Distribution
    deadline_misses: int
    qp_failures: int
    degraded_ticks: int
    """Ticks answered without a sensor, or while giving up."""
    reason: str
    """Why the stabilizer ended, or gave up."""
    refused: dict[str, int]
    clipped: dict[str, int]
    ticks: int
    log_sha256: str
    out: str | None
    pushes: list[PushEvent] = []
    """Pushes asked for during the run, besides the scenario's."""
    settings_changes: list[SettingsChange] = []
    """Changes of settings during the run."""
    relay: RelayResult | None = None
    """What a relay did to the bus, if there was one."""
