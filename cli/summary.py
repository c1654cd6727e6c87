"""Tables of results, scenarios, studies and records for people to read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.bar import Bar
from rich.console import Group as RenderableGroup
from rich.table import Table
from rich.text import Text

from surefoot.cli.console import new_table
from surefoot.outcome import Judgement
from surefoot.schemas.motions import ROTATIONS
from surefoot.schemas.reasons import NONE, EndReason, counted, given, in_words, plain
from surefoot.schemas.result import (
    ControllerResult,
    Distribution,
    Histogram,
    PlantResult,
    RecordedGround,
    RelayResult,
    RunResult,
)

if TYPE_CHECKING:
    from surefoot.playback.recompute import Difference, ReplayOutcome
    from surefoot.recording.read import ChannelCount
    from surefoot.schemas.scenario import Scenario
    from surefoot.studies.summaries import Summaries

_PASSAGE = ("arrived", "left")
"""Counts of a relay that are no faults."""

BAR_WIDTH = 40

SLIVER = 0.126 / BAR_WIDTH
"""Least length of a histogram's bar, as a share: an eighth of a character."""


def run_table(result: RunResult) -> RenderableGroup:
    """Return a table of a run's figures."""
    table = _figures(
        f"{result.scenario}, {result.controller}, {result.robot}, seed {result.seed}, "
        f"{result.mode}"
    )
    _add_outcome(table, Judgement(result.outcome, result.outcome_detail))
    if result.ticks:
        _add_figures(table, result)
    if result.end is EndReason.NONE:
        table.add_row("stabilizer", result.end_detail)
    elif result.end is not EndReason.RUN_OVER:
        table.add_row("stabilizer", in_words(result.end, result.end_detail))
    if result.relay is not None:
        table.add_row(f"relay, {result.relay.plan}", _faults(result.relay))
    if result.out is not None:
        table.add_section()
        table.add_row("kept in", result.out)
    return _with_histograms(table, result)


def _add_figures(table: Table, result: RunResult) -> None:
    """Add what was measured, of a run that reached its first tick."""
    _add_motion(table, result, walked=result.has_walked)
    _add_forces(table, result, walked=result.has_walked)
    _add_force_error(table, result)
    table.add_section()
    _add_timing(table, result)
    is_known = result.end is not EndReason.NONE
    if is_known:
        table.add_row("controller tick", _times(result.tick_ms))
    _add_gate(table, result)
    if result.mode == "realtime":
        table.add_row("ticks skipped, answered late", _late(result))
    if is_known:
        table.add_row("QP failures", str(result.qp_failures))
    _add_losses(table, result)


def plant_table(
    result: PlantResult, judgement: Judgement, *, title: str
) -> RenderableGroup:
    """Return a table of the simulated robot's figures."""
    table = _figures(title)
    _add_outcome(table, judgement)
    if result.ticks:
        _add_motion(table, result, walked=result.is_walk)
        _add_forces(table, result, walked=result.is_walk)
        table.add_section()
        _add_timing(table, result)
        _add_gate(table, result)
    return _with_histograms(table, result)


def controller_table(
    result: ControllerResult, name: str, *, is_realtime: bool
) -> RenderableGroup:
    """Return a table of the stabilizer's figures."""
    table = _figures(f"{name}: {in_words(result.end, result.end_detail)}")
    table.add_row("ticks", str(result.ticks))
    table.add_row("controller tick", _times(result.tick_ms))
    _add_force_error(table, result)
    table.add_row("QP failures", str(result.qp_failures))
    table.add_row("stale snapshots", str(result.stale_snapshots))
    if is_realtime:
        table.add_row("ticks skipped, answered late", _late(result))
    _add_losses(table, result)
    if result.restarts:
        table.add_row("started anew", f"{result.restarts} times")
    return _with_histograms(table, result)


def relay_table(result: RelayResult) -> Table:
    """Return a table of what a relay did to each channel."""
    kinds = [kind for kind in _fault_counts(result) if kind not in _PASSAGE]
    table = new_table(result.plan, "channel", *_PASSAGE, *kinds)
    for name, counts in result.counts.items():
        row = [str(counts.get(kind, 0)) for kind in (*_PASSAGE, *kinds)]
        table.add_row(name, *row)
    return table


def study_tables(summaries: Summaries) -> RenderableGroup:
    """Return one table per case."""
    from surefoot.studies.summaries import cells_of

    tables: dict[str, Table] = {}
    for group, summary in summaries.items():
        if group.case not in tables:
            headings = ("controller", "servo", "up", "95 %")
            figures = ("CoM rms [mm]", "force [N]", "peak [N]")
            tables[group.case] = new_table(group.case, *headings, *figures)
        tables[group.case].add_row(*cells_of(group, summary)[1:8])
    note = "CoM rms x, y, z and deviation of the forces: mean over runs that stayed up"
    return RenderableGroup(*tables.values(), note)


def scenario_table(scenarios: Mapping[str, Scenario]) -> Table:
    """Return a table of scenarios by name."""
    table = Table(box=None, pad_edge=False)
    table.add_column("scenario", no_wrap=True, style="bold")
    table.add_column("duration", justify="right")
    table.add_column("what happens")
    for name, scenario in scenarios.items():
        text = scenario.description or scenario.name
        table.add_row(name, f"{scenario.duration_s:g} s", text)
    return table


def rows_table(rows: Sequence[Mapping[str, object]]) -> Table:
    """Return a table of rows that have the same keys."""
    table = Table(box=None, pad_edge=False)
    for number, key in enumerate(rows[0]):
        style = "bold" if number == 0 else None
        table.add_column(key.replace("_", " "), no_wrap=number == 0, style=style)
    for row in rows:
        table.add_row(*map(_in_cell, row.values()))
    return table


def _in_cell(value: object) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(map(_in_cell, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _figures(title: str) -> Table:
    table = Table(title=title, title_justify="left", show_header=False)
    table.add_column(overflow="fold")
    table.add_column(justify="right", overflow="fold")
    return table


def _add_outcome(table: Table, judgement: Judgement) -> None:
    colour = "green" if judgement.outcome.is_up else "red"
    table.add_row("outcome", Text(judgement.sentence, f"bold {colour}"))


def _add_motion(table: Table, result: RunResult | PlantResult, *, walked: bool) -> None:
    """Add CoM errors of a robot that stood, DCM errors of one that walked."""
    if not walked:
        table.add_row("CoM error rms (x, y, z)", _row(result.com_error_rms_mm, "mm"))
        table.add_row("CoM error max (x, y, z)", _row(result.com_error_max_mm, "mm"))
    elif isinstance(result, RunResult) and result.placement_error_max_mm is not None:
        table.add_row("DCM error rms (x, y)", _row(result.dcm_error_rms_mm, "mm"))
        table.add_row("DCM error max (x, y)", _row(result.dcm_error_max_mm, "mm"))
        table.add_row("placement error max", f"{result.placement_error_max_mm:.1f} mm")
    table.add_row("base tilt max", f"{result.base_tilt_max_deg:.1f} deg")
    table.add_section()


def _add_forces(table: Table, result: RunResult | PlantResult, *, walked: bool) -> None:
    peak = _row(result.force_peak_n, "N", since_s=0.2)
    for ground in result.recorded_ground:
        table.add_row(f"ground, {ground.file}", _recorded(ground))
    table.add_row("force peak (left, right)", peak)
    if not walked:
        table.add_row("contact lost (left, right)", _row(result.contact_lost_s, "s"))
    elif result.touchdown_peak_n is not None:
        table.add_row(
            "touchdown peak (left, right)", _row(result.touchdown_peak_n, "N")
        )


def _add_force_error(table: Table, result: RunResult | ControllerResult) -> None:
    if result.force_error_rms_n is not None:
        error = _row(result.force_error_rms_n, "N")
        table.add_row("force error rms (left, right)", error)


def _add_losses(table: Table, result: RunResult | ControllerResult) -> None:
    if result.lost_sensors:
        lost = ", ".join(f"{x} {plain(why)}" for x, why in result.lost_sensors.items())
        table.add_row("sensors lost", lost)
        table.add_row("ticks without a sensor", str(result.degraded_ticks))


def _recorded(ground: RecordedGround) -> str:
    unit = "deg" if ground.axis in ROTATIONS else "m"
    return (
        f"{ground.axis} over {ground.stroke:.3g} {unit}, {ground.speed_max:.2g} "
        f"{unit}/s, {ground.acceleration_max:.2g} {unit}/s^2"
    )


def _add_timing(table: Table, result: RunResult | PlantResult) -> None:
    table.add_row("real-time factor", f"{result.real_time_factor:.2f}")
    if result.round_trip_ms.max > 0.0:
        table.add_row("round trip", _times(result.round_trip_ms))
    if result.end_to_end_ms.max > 0.0:
        table.add_row("sensors to servos", _times(result.end_to_end_ms))
    if result.period_jitter_ms.max > 0.0:
        table.add_row("period jitter", _times(result.period_jitter_ms))


def _add_gate(table: Table, result: RunResult | PlantResult) -> None:
    table.add_row(
        "ticks, missed deadlines", f"{result.ticks}, {result.deadline_misses}"
    )
    if result.unrecorded_ticks:
        table.add_row(
            "ticks not recorded",
            Text.assemble((f"{result.unrecorded_ticks}", "bold red"), ", slow disk"),
        )
    table.add_row("commands refused", counted(result.refused))
    table.add_row("commands clipped", counted(result.clipped))


def _row(values: Sequence[float] | None, unit: str, *, since_s: float = 1.0) -> str:
    if values is None:
        return f"none; counts from {since_s:g} s on"
    return f"{', '.join(f'{value:.1f}' for value in values)} {unit}"


def _times(times: Distribution) -> str:
    return f"median {times.median:.3f}, p99 {times.p99:.3f}, max {times.max:.3f} ms"


def _late(result: RunResult | ControllerResult) -> str:
    return f"{result.skipped_ticks}, {result.slow_ticks}"


def _fault_counts(result: RelayResult) -> Counter[str]:
    """Count the messages that each kind of fault changed, over all channels."""
    total: Counter[str] = Counter()
    for counts in result.counts.values():
        total.update(counts)
    return total


def _faults(result: RelayResult) -> str:
    total = _fault_counts(result)
    passed = total["arrived"]
    found = {kind: n for kind, n in total.items() if kind not in _PASSAGE}
    return f"{counted(found)} of {passed} messages"


def histogram_table(name: str, histogram: Histogram) -> Table:
    """Return a table with one row per range of times, from the first to the last used.

    Bars are proportional to the share. A bar of a used range has at least a visible
    length, so that rare late ticks show.
    """
    edges, counts = histogram.edges_ms, histogram.counts
    total = sum(counts)
    headings = ("ms", "", "count", "share")
    table = new_table(f"{name}, {total} times", figures=headings, boxed=False)
    table.columns[1].justify, table.columns[1].width = "left", BAR_WIDTH
    filled = [index for index, count in enumerate(counts) if count]
    if not filled:
        return table
    most = max(counts)
    for index in range(filled[0], filled[-1] + 1):
        count = counts[index]
        table.add_row(
            _range(edges, index),
            Bar(most, 0, max(count, SLIVER * most), width=BAR_WIDTH) if count else "",
            str(count),
            f"{100.0 * count / total:.2f} %",
        )
    return table


def _with_histograms(
    table: Table, result: RunResult | PlantResult | ControllerResult
) -> RenderableGroup:
    below = [histogram_table(*named) for named in result.histograms.items()]
    return RenderableGroup(table, *below)


def _range(edges: list[float], index: int) -> str:
    if index == 0:
        return f"under {edges[0]:g}"
    if index == len(edges):
        return f"over {edges[-1]:g}"
    return f"{edges[index - 1]:g} to {edges[index]:g}"


def counts_table(counts: Iterable[ChannelCount]) -> Table:
    """Return a table of what came on each channel, and what is missing."""
    counts = list(counts)
    odd = any(count.unreadable for count in counts)
    headings = ("channel", "messages", "first", "last", "missing", "restarts")
    table = new_table("", *headings, *(("not readable",) if odd else ()))
    for count in counts:
        counted = bool(count.counted_by)
        row = (
            count.channel,
            str(count.messages),
            given(count.first),
            given(count.last),
            f"{count.missing} by {count.counted_by}" if counted else NONE,
            str(count.restarts) if counted else NONE,
        )
        unreadable = f"{count.unreadable}{count.encoding and f' ({count.encoding})'}"
        table.add_row(*row, *((unreadable,) if odd else ()))
    return table


def outcome_table(outcome: ReplayOutcome) -> Table:
    """Return a table with one row per stabilizer of the record."""
    headings = ("stabilizer", "controller", "ticks", "compared", "differing")
    table = new_table("", *headings)
    for session in outcome.sessions:
        table.add_row(
            session.commander,
            session.controller,
            f"{session.first_tick} to {session.last_tick}",
            str(session.compared),
            str(session.differing),
        )
    return table


def verdict(outcome: ReplayOutcome) -> str:
    """Tell whether all commands are equal, or where they differ first and most."""
    if outcome.is_equal:
        return f"all {outcome.compared} commands are equal, bit for bit"
    session = next(session for session in outcome.sessions if session.differing)
    first, largest = session.first, session.largest
    assert first is not None
    assert largest is not None
    return (
        f"{session.differing} of {session.compared} commands of {session.commander} "
        f"differ\n"
        f"first: {_words(first)}\n"
        f"largest: {_words(largest)}\n"
        "Each tick uses the recorded sensors. This does not tell how the robot would "
        "have moved with the computed commands."
    )


def _words(found: Difference) -> str:
    return (
        f"tick {found.tick} ({found.time_s:.3f} s), {found.joint}: recorded "
        f"{found.recorded:.17g}, computed {found.computed:.17g} rad, "
        f"{found.error:+.3g}"
    )
