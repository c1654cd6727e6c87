"""Moments that every plot marks."""

from __future__ import annotations

from typing import NamedTuple

from cli.report.colours import RUN_COLOURS
from cli.report.run_data import RunData

GREY = "#8a929c"


class Mark(NamedTuple):
    """A moment: when [s], what happened, and the colour of its line."""

    time: float
    text: str
    colour: str


def marks_of(runs: list[RunData]) -> list[Mark]:
    """Pushes, sensor faults, changes of settings and falls, each once."""
    marks = []
    for index, run in enumerate(runs):
        colour = RUN_COLOURS[index] if len(runs) > 1 else GREY
        period_s = run.robot.period_s
        marks += [Mark(push.start_s, "push", GREY) for push in run.scenario.push]
        marks += [
            Mark(fault.start_s, f"{fault.sensor}: {fault.kind}", GREY)
            for fault in run.scenario.fault
        ]
        result = run.result
        marks += [Mark(p.tick * period_s, "push asked", colour) for p in result.pushes]
        marks += [
            Mark(change.tick * period_s, "settings", colour)
            for change in result.settings_changes
        ]
        if result.fell_at_s is not None:
            marks.append(Mark(result.fell_at_s, "fell", colour))
    return list(dict.fromkeys(marks))
