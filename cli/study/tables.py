"""Tables of a study: for the terminal, as CSV, as Markdown."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from rich.console import Group as RenderableGroup
from rich.table import Table

from cli.atomic_file import atomic_file
from cli.study.cell import Group
from cli.study.summarise import GroupSummary

Summaries = dict[Group, GroupSummary]
NONE = "-"
COLUMNS = (
    "case",
    "controller",
    "servo",
    "up",
    "up, 95 %",
    "CoM rms x, y, z [mm]",
    "force deviation [N]",
    "force peak [N]",
    "longest without ground [s]",
)


def cells_of(group: Group, summary: GroupSummary) -> list[str]:
    """A group's row, as text."""
    com = summary.com_rms_mm
    return [
        group.case,
        group.variant,
        group.servo_profile,
        f"{summary.up} of {summary.runs}",
        f"{summary.up_from:.2f} to {summary.up_to:.2f}",
        NONE if com is None else ", ".join(f"{value:.1f}" for value in com),
        _text(summary.force_deviation_n, ".0f"),
        _text(summary.force_peak_n, ".0f"),
        _text(summary.contact_gap_s, ".3f"),
    ]


def terminal_tables(summaries: Summaries) -> RenderableGroup:
    """For people at a terminal: a table a case."""
    tables: dict[str, Table] = {}
    for group, summary in summaries.items():
        if group.case not in tables:
            tables[group.case] = Table(
                *("controller", "servo", "up", "95 %"),
                *("CoM rms [mm]", "force [N]", "peak [N]"),
                title=group.case,
                title_justify="left",
            )
        tables[group.case].add_row(*cells_of(group, summary)[1:8])
    note = "CoM rms x, y, z and deviation of the forces: mean over runs that stayed up"
    return RenderableGroup(*tables.values(), note)


def markdown_table(summaries: Summaries) -> str:
    """For a page."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    lines += [
        "| " + " | ".join(cells_of(group, summary)) + " |"
        for group, summary in summaries.items()
    ]
    return "\n".join(lines) + "\n"


def write_csv(path: Path, summaries: Summaries) -> None:
    """One line a group, one number a column."""
    with atomic_file(path) as raw:
        text = io.TextIOWrapper(raw, encoding="utf-8", newline="", write_through=True)
        writer = csv.writer(text)
        header: list[str] | None = None
        for group, summary in summaries.items():
            flat = _flat(group, summary)
            if header is None:
                header = list(flat)
                writer.writerow(header)
            writer.writerow(flat.values())
        text.detach()


def _flat(group: Group, summary: GroupSummary) -> dict[str, object]:
    nothing: list[float | None] = [None] * 3
    com = summary.com_rms_mm or nothing
    largest = summary.com_max_mm or nothing
    return {
        "scenario": group.scenario,
        "values": "; ".join(f"{name}={value}" for name, value in group.values),
        "controller": group.variant,
        "servo_profile": group.servo_profile,
        "runs": summary.runs,
        "up": summary.up,
        "up_from": summary.up_from,
        "up_to": summary.up_to,
        **{f"com_rms_{a}_mm": v for a, v in zip("xyz", com, strict=True)},
        **{f"com_max_{a}_mm": v for a, v in zip("xyz", largest, strict=True)},
        "tilt_max_deg": summary.tilt_max_deg,
        "force_deviation_n": summary.force_deviation_n,
        "force_peak_n": summary.force_peak_n,
        "contact_gap_s": summary.contact_gap_s,
    }


def _text(value: float | None, form: str) -> str:
    return NONE if value is None else format(value, form)
