"""Tables of figures and settings, with a column for each run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec

from surefoot.outcome import Judgement
from surefoot.report.run_data import RunData
from surefoot.schemas.reasons import counted, in_words
from surefoot.schemas.result import RunResult
from surefoot.schemas.settings import build_settings

NO_SETTING = "-"
NO_FIGURE = "none"


class Cell(NamedTuple):
    """One value of a table.

    Attributes:
        text: the value.
        change: difference from the first run, with its sign; empty for the first run,
            for words and for no difference.
    """

    text: str
    change: str


class Row(NamedTuple):
    """One row: name, unit, and a cell for each run."""

    name: str
    unit: str
    cells: list[Cell]


class SettingRow(NamedTuple):
    """One setting.

    Attributes:
        name: ``section.name``.
        default: default of this version.
        values: value of each run.
        is_changed: for each run, whether the value differs from the default.
    """

    name: str
    default: str
    values: list[str]
    is_changed: list[bool]


class _Figure(NamedTuple):
    name: str
    unit: str
    decimals: int
    value: Callable[[RunResult], float | None]


def _parts(
    name: str,
    unit: str,
    field: str,
    parts: tuple[str, ...],
    *,
    decimals: int = 1,
    of_walks: bool = True,
) -> list[_Figure]:
    """Return a figure for each entry of a list in the result.

    Args:
        name: common part of the figures' names.
        unit: unit of all.
        field: name of the list in the result.
        parts: last part of each figure's name, in the order of the entries.
        decimals: digits after the point.
        of_walks: whether the figure is meaningful for a walk.
    """

    def value_of(index: int) -> Callable[[RunResult], float | None]:
        def value(result: RunResult) -> float | None:
            values = getattr(result, field)
            if values is None or (result.has_walked and not of_walks):
                return None
            return float(values[index])

        return value

    return [
        _Figure(f"{name} {part}", unit, decimals, value_of(index))
        for index, part in enumerate(parts)
    ]


def _times(name: str, field: str) -> list[_Figure]:
    def value_of(part: str) -> Callable[[RunResult], float | None]:
        def value(result: RunResult) -> float | None:
            times = getattr(result, field)
            return float(getattr(times, part)) if times.max > 0.0 else None

        return value

    return [
        _Figure(f"{name}, {part}", "ms", 3, value_of(part))
        for part in ("median", "p99", "max")
    ]


_XYZ, _SIDES = ("x", "y", "z"), ("left", "right")
_FIGURES = [
    _Figure("duration", "s", 2, lambda result: result.duration_s),
    _Figure("steps taken", "", 0, lambda result: result.steps_done),
    _Figure("distance walked", "m", 2, lambda result: result.distance_m),
    *_parts("DCM error rms", "mm", "dcm_error_rms_mm", _XYZ[:2]),
    *_parts("DCM error max", "mm", "dcm_error_max_mm", _XYZ[:2]),
    _Figure("placement error max", "mm", 1, lambda r: r.placement_error_max_mm),
    *_parts("touchdown peak", "N", "touchdown_peak_n", _SIDES, decimals=0),
    *_parts("CoM error rms", "mm", "com_error_rms_mm", _XYZ, of_walks=False),
    *_parts("CoM error max", "mm", "com_error_max_mm", _XYZ, of_walks=False),
    _Figure("base tilt max", "deg", 2, lambda result: result.base_tilt_max_deg),
    *_parts("force peak", "N", "force_peak_n", _SIDES),
    *_parts("F_z against desired rms", "N", "force_error_rms_n", _SIDES),
    *_parts(
        "F_z against half weight rms",
        "N",
        "force_deviation_rms_n",
        _SIDES,
        of_walks=False,
    ),
    *_parts("contact lost", "s", "contact_lost_s", _SIDES, decimals=3, of_walks=False),
    *_parts(
        "longest without contact",
        "s",
        "contact_gap_s",
        _SIDES,
        decimals=3,
        of_walks=False,
    ),
    *_times("controller tick", "tick_ms"),
    *_times("round trip", "round_trip_ms"),
    *_times("period jitter", "period_jitter_ms"),
    _Figure("real-time factor", "", 2, lambda result: result.real_time_factor),
    _Figure("ticks", "", 0, lambda result: result.ticks),
    _Figure("missed deadlines", "", 0, lambda result: result.deadline_misses),
    _Figure("QP failures", "", 0, lambda result: result.qp_failures),
    _Figure("ticks without a sensor", "", 0, lambda result: result.degraded_ticks),
]
_WORDS: list[tuple[str, Callable[[RunResult], str]]] = [
    ("outcome", lambda result: sentence(result)),
    ("stabilizer", lambda result: in_words(result.end, result.end_detail)),
    ("commands refused", lambda result: counted(result.refused)),
    ("commands clipped", lambda result: counted(result.clipped)),
    ("log_sha256", lambda result: result.log_sha256[:16]),
]


def sentence(result: RunResult) -> str:
    """Return in words how a run went, when and why."""
    return Judgement(result.outcome, result.outcome_detail).sentence


def figure_rows(results: list[RunResult]) -> list[Row]:
    """Return the figures that at least one run has, with differences to the first."""
    rows = [
        Row(name, "", [Cell(said(result), "") for result in results])
        for name, said in _WORDS
    ]
    numbers = [
        Row(figure.name, figure.unit, _cells(figure, results))
        for figure in _FIGURES
        if any(figure.value(result) is not None for result in results)
    ]
    return [rows[0], *numbers, *rows[1:]]


def setting_rows(runs: list[RunData]) -> list[SettingRow]:
    """Return all settings of the runs with the defaults of this version."""
    shipped = build_settings({}, overrides=[], source="defaults")
    defaults = {
        f"{section}.{name}": value
        for section, table in msgspec.to_builtins(shipped).items()
        for name, value in table.items()
    }
    names = [*defaults, *(name for run in runs for name in run.settings)]
    return [
        SettingRow(
            name=name,
            default=_text(defaults.get(name)),
            values=[_text(run.settings.get(name)) for run in runs],
            is_changed=[
                _text(run.settings.get(name)) != _text(defaults.get(name))
                for run in runs
            ],
        )
        for name in dict.fromkeys(names)
    ]


def _cells(figure: _Figure, results: list[RunResult]) -> list[Cell]:
    values = [figure.value(result) for result in results]
    first = values[0]
    cells = []
    for value in values:
        if value is None or first is None:
            said = NO_FIGURE if value is None else f"{value:.{figure.decimals}f}"
            cells.append(Cell(said, ""))
            continue
        change = f"{value - first:+.{figure.decimals}f}"
        is_same = float(change) == 0.0
        cells.append(Cell(f"{value:.{figure.decimals}f}", "" if is_same else change))
    return cells


def _text(value: Any) -> str:
    if value is None:
        return NO_SETTING
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, float):
        return f"{value:.10g}"
    return str(value).lower() if isinstance(value, bool) else str(value)
