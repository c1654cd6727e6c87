"""Writes what a study amounts to into its folder."""

from __future__ import annotations

from pathlib import Path

import msgspec

from cli.atomic_file import atomic_file
from cli.study.curves import curves_over, draw_curves
from cli.study.tables import Summaries, write_csv


def write_summary(folder: Path, summaries: Summaries) -> list[dict[str, object]]:
    """Writes summary.csv, summary.json and a success curve per varied value.

    Returns:
        What summary.json holds.
    """
    write_csv(folder / "summary.csv", summaries)
    rows: list[dict[str, object]] = [
        {
            "scenario": group.scenario,
            "values": dict(group.values),
            "controller": group.variant,
            "servo_profile": group.servo_profile,
            **summary.as_dict(),
        }
        for group, summary in summaries.items()
    ]
    _write(folder / "summary.json", msgspec.json.format(msgspec.json.encode(rows)))
    varied = {
        (group.scenario, name)
        for group in summaries
        for name, value in group.values
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
    for scenario, name in sorted(varied):
        curves = curves_over(summaries, scenario=scenario, name=name)
        svg = draw_curves(curves, xlabel=name, title=scenario, mark=None)
        stem = Path(scenario).stem
        _write(folder / f"success-{stem}-{name.replace('*', 'all')}.svg", svg)
    return rows


def _write(path: Path, data: bytes) -> None:
    with atomic_file(path) as file:
        file.write(data)
