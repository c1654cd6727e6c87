"""Tables people read: the result of a run, and the scenarios there are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from rich.table import Table

from schemas.result import (
    ControllerResult,
    Distribution,
    PlantResult,
    RelayResult,
    RunResult,
)

_PASSAGE = ("arrived", "left")
"""What a relay counts besides its faults."""


class ScenarioRow(NamedTuple):
    """One line of the list of scenarios."""

    name: str
    duration_s: float
    description: str


def run_table(result: RunResult) -> Table:
    """The figures of a run."""
    table = _figures(
        f"{result.scenario}, {result.controller}, {result.robot}, seed {result.seed}, "
        f"{result.mode}"
    )
    _add_standing(table, result)
    _add_forces(table, result)
    table.add_row("force error rms (left, right)", _row(result.force_error_rms_n, "N"))
    table.add_section()
    _add_timing(table, result)
    table.add_row("controller tick", _times(result.tick_ms))
    _add_gate(table, result)
    table.add_row("ticks skipped, answered late", _late(result))
    table.add_row("QP failures", str(result.qp_failures))
    if result.degraded_ticks:
        table.add_row("ticks without a sensor", str(result.degraded_ticks))
    if not result.reason.startswith("run over"):
        table.add_row("stabilizer", result.reason)
    if result.relay is not None:
        table.add_row(f"relay, {result.relay.plan}", _faults(result.relay))
    if result.out is not None:
        table.add_section()
        table.add_row("kept in", result.out)
    return table


def plant_table(result: PlantResult, title: str) -> Table:
    """The figures of the simulated robot alone."""
    table = _figures(title)
    _add_standing(table, result)
    _add_forces(table, result)
    table.add_section()
    _add_timing(table, result)
    _add_gate(table, result)
    return table


def controller_table(result: ControllerResult, name: str) -> Table:
    """The figures of the stabilizer alone."""
    table = _figures(f"{name}: {result.reason}")
    table.add_row("ticks", str(result.ticks))
    table.add_row("controller tick", _times(result.tick_ms))
    table.add_row("force error rms (left, right)", _row(result.force_error_rms_n, "N"))
    table.add_row("QP failures", str(result.qp_failures))
    table.add_row("stale snapshots", str(result.stale_snapshots))
    table.add_row("ticks skipped, answered late", _late(result))
    if result.restarts:
        table.add_row("started anew", f"{result.restarts} times")
    return table


def relay_table(result: RelayResult) -> Table:
    """What a relay did to each channel."""
    kinds = [kind for kind in _fault_counts(result) if kind not in _PASSAGE]
    table = Table("channel", *_PASSAGE, *kinds, title=result.plan)
    for name, counts in result.counts.items():
        row = [str(counts.get(kind, 0)) for kind in (*_PASSAGE, *kinds)]
        table.add_row(name, *row)
    return table


def scenario_table(rows: Iterable[ScenarioRow]) -> Table:
    """The shipped scenarios."""
    table = Table(box=None, pad_edge=False)
    table.add_column("scenario", no_wrap=True, style="bold")
    table.add_column("duration", justify="right")
    table.add_column("what happens")
    for row in rows:
        table.add_row(row.name, f"{row.duration_s:g} s", row.description)
    return table


def _figures(title: str) -> Table:
    table = Table(title=title, title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    return table


def _add_standing(table: Table, result: RunResult | PlantResult) -> None:
    if result.fell:
        verdict = f"[bold red]fell at {result.fell_at_s:.2f} s[/]"
    else:
        verdict = f"[bold green]stood {result.duration_s:g} s[/]"
    table.add_row("robot", verdict)
    table.add_row("CoM error rms (x, y, z)", _row(result.com_error_rms_mm, "mm"))
    table.add_row("CoM error max (x, y, z)", _row(result.com_error_max_mm, "mm"))
    table.add_row("base tilt max", f"{result.base_tilt_max_deg:.1f} deg")
    table.add_section()


def _add_forces(table: Table, result: RunResult | PlantResult) -> None:
    table.add_row("force peak (left, right)", _row(result.force_peak_n, "N"))
    table.add_row("contact lost (left, right)", _row(result.contact_lost_s, "s"))


def _add_timing(table: Table, result: RunResult | PlantResult) -> None:
    table.add_row("real-time factor", f"{result.real_time_factor:.2f}")
    table.add_row("round trip", _times(result.round_trip_ms))
    if result.end_to_end_ms.max > 0.0:
        table.add_row("sensors to servos", _times(result.end_to_end_ms))
    table.add_row("period jitter", _times(result.period_jitter_ms))


def _add_gate(table: Table, result: RunResult | PlantResult) -> None:
    table.add_row(
        "ticks, missed deadlines", f"{result.ticks}, {result.deadline_misses}"
    )
    table.add_row("commands refused", _counts(result.refused))
    table.add_row("commands clipped", _counts(result.clipped))


def _row(values: Sequence[float] | None, unit: str) -> str:
    if values is None:
        return "none; counts from 1 s on"
    return f"{', '.join(f'{value:.1f}' for value in values)} {unit}"


def _times(times: Distribution) -> str:
    return f"median {times.median:.3f}, p99 {times.p99:.3f}, max {times.max:.3f} ms"


def _late(result: RunResult | ControllerResult) -> str:
    return f"{result.skipped_ticks}, {result.slow_ticks}"


def _counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"


def _fault_counts(result: RelayResult) -> Counter[str]:
    """Messages that each kind of fault did something to, over all channels."""
    total: Counter[str] = Counter()
    for counts in result.counts.values():
        total.update(counts)
    return total


def _faults(result: RelayResult) -> str:
    total = _fault_counts(result)
    passed = total["arrived"]
    found = {kind: n for kind, n in total.items() if kind not in _PASSAGE}
    return f"{_counts(found)} of {passed} messages"
