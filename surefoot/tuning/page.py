"""The page of a search: front, importance of parameters, before and after."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import optuna
import tomli_w
from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances

from surefoot.errors import UsageError
from surefoot.out_folder import write_json, write_whole
from surefoot.presentation import canvas, svg_of, write_rows
from surefoot.run_plan import resolve_settings
from surefoot.schemas.settings import ControllerSettings
from surefoot.studies.paper_page import inline_svg, render
from surefoot.tuning.ask import Spec
from surefoot.tuning.outcome import Candidate, Comparison, Tuned, value_text
from surefoot.tuning.parameters import overrides_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LOG = logging.getLogger(__name__)
GREY, BLUE, ORANGE = "#9aa6b5", "#2a6fbb", "#d9730d"
OUTCOME, SETTINGS, PAGE, TRIALS = (
    "tune.json",
    "settings.toml",
    "index.html",
    "trials.csv",
)
FRONT = "front"
SPEC = "search"
"""Key of the specification in tune.json."""
WRITTEN = "written"
"""Key of the settings files in tune.json: SHA-256 by path in the folder."""
LEAST_FOR_IMPORTANCE = 20
"""Number of trials below which no importance is shown."""


def draw_front(tuned: Tuned) -> bytes:
    """Draw two objectives against each other, or a single one over the trials."""
    figure, axes = canvas(7.2, 4.2)
    objectives = tuned.spec.figures
    stood = [c for c in tuned.candidates if not c.stopped]
    if len(objectives) == 1:
        axes.set(xlabel="trial", ylabel=_label(objectives[0]))
        _points(axes, [[c.place for c in stood], [c.figures[0] for c in stood]], GREY)
    else:
        axes.set(xlabel=_label(objectives[0]), ylabel=_label(objectives[1]))
        _points(axes, _two(stood), GREY, "trials that stood")
        lined = len(objectives) == 2
        _points(axes, _two(tuned.front), BLUE, "on the front", line=lined)
    for candidate, name, colour in (
        (tuned.start, "start", "black"),
        (tuned.chosen, "chosen", ORANGE),
    ):
        x, y = (
            (candidate.place, candidate.figures[0])
            if len(objectives) == 1
            else candidate.figures[:2]
        )
        axes.plot(x, y, "o", color=colour, markersize=10, fillstyle="none", label=name)
    return svg_of(figure)


def _label(objective: Any) -> str:
    return f"{objective.about} [{objective.unit or 1}]"


def _two(candidates: Sequence[Candidate]) -> list[list[float]]:
    return [[c.figures[i] for c in candidates] for i in (0, 1)]


def _points(
    axes: Axes,
    xy: Sequence[Sequence[float]],
    colour: str,
    label: str | None = None,
    *,
    line: bool = False,
) -> None:
    style = "-" if line else ""
    axes.plot(*xy, linestyle=style, marker="o", markersize=4, color=colour, label=label)


def draw_importance(weights: dict[str, dict[str, float]]) -> bytes:
    """Draw the weight of each parameter for each objective."""
    names = sorted({name for of in weights.values() for name in of}, reverse=True)
    figure, axes = canvas(7.2, 1.4 + 0.3 * len(names))
    height = 0.8 / len(weights)
    for index, (objective, of) in enumerate(weights.items()):
        places = [place - 0.4 + height * (index + 0.5) for place in range(len(names))]
        axes.barh(places, [of.get(n, 0.0) for n in names], height, label=objective)
    axes.set_yticks(range(len(names)), names)
    axes.set(xlabel="share in deciding whether a trial is among the best tenth")
    axes.grid(visible=False, axis="y")
    return svg_of(figure)


TEMPLATE = Path(__file__).parent / "tune.html.j2"


def write_outcome(folder: Path, tuned: Tuned, study: optuna.Study) -> None:
    """Write settings, page, figures and all trials.

    Args:
        folder: gets settings.toml, index.html, tune.json, trials.csv, and in ``front``
            the settings of each trial on the front.
        tuned: outcome of the search.
        study: Optuna's view, for the importance of the parameters.
    """
    weights = importance(tuned, study)
    texts = {SETTINGS: _settings(tuned, tuned.chosen)}
    for candidate in tuned.front:
        name = f"{FRONT}/trial-{candidate.place:04d}.toml"
        texts[name] = _settings(tuned, candidate)
    _keep_edited(folder)
    hashes = {name: hashlib.sha256(text).hexdigest() for name, text in texts.items()}
    outcome = as_dict(tuned, weights) | {WRITTEN: hashes}
    write_json(folder / OUTCOME, outcome)  # marks the folder as ours
    (folder / FRONT).mkdir(exist_ok=True)
    for former in _front_files(folder):
        former.unlink()
    for name, text in texts.items():
        write_whole(folder / name, text)
    write_rows(folder / TRIALS, _trials(tuned))
    write_whole(folder / PAGE, render(TEMPLATE, **_values(tuned, weights)).encode())


def read_spec(folder: Path) -> Spec | None:
    """Return the specification of the search whose outcome a folder holds, if any.

    Raises:
        UsageError: tune.json does not say it.
    """
    try:
        told = _told(folder)
        return None if told is None else msgspec.convert(told.get(SPEC), Spec)
    except msgspec.DecodeError as error:
        raise UsageError(
            f"--out {folder}: {OUTCOME} there does not say of which search it is "
            f"({error}), and its files would be replaced; name another folder"
        ) from error


def _told(folder: Path) -> dict[str, Any] | None:
    path = folder / OUTCOME
    if not path.is_file():
        return None
    return msgspec.json.decode(path.read_bytes(), type=dict[str, Any])


def _front_files(folder: Path) -> list[Path]:
    return sorted((folder / FRONT).glob("trial-[0-9][0-9][0-9][0-9].toml"))


def _keep_edited(folder: Path) -> None:
    """Rename settings files that someone edited after a former call wrote them."""
    written = (_told(folder) or {}).get(WRITTEN, {})
    for file in (folder / SETTINGS, *_front_files(folder)):
        name = file.relative_to(folder).as_posix()
        if name not in written or not file.is_file():
            continue
        if hashlib.sha256(file.read_bytes()).hexdigest() == written[name]:
            continue
        stems = (f"{file.stem}-edited-{number}" for number in count(1))
        kept = next(k for k in map(file.with_stem, stems) if not k.exists())
        file.rename(kept)
        _LOG.warning("%s was edited since it was written; kept as %s", file, kept.name)


def importance(tuned: Tuned, study: optuna.Study) -> dict[str, dict[str, float]]:
    """Return each parameter's weight for each objective, between 0 and 1.

    PED-ANOVA tells how much a parameter decides whether a trial is among the best
    tenth. Empty for few trials, or for one parameter.
    """
    few = len(tuned.candidates) < LEAST_FOR_IMPORTANCE
    if few or len(tuned.spec.parameters) < 2:
        return {}
    return {
        name: get_param_importances(
            study,
            evaluator=PedAnovaImportanceEvaluator(),
            target=partial(_value, index=index),
        )
        for index, name in enumerate(tuned.spec.objectives)
    }


def _value(trial: optuna.trial.FrozenTrial, index: int) -> float:
    return float(trial.values[index])


def as_dict(
    tuned: Tuned, weights: dict[str, dict[str, float]] | None = None
) -> dict[str, Any]:
    """Return the outcome as built-in types: the content of tune.json.

    Args:
        tuned: outcome of the search.
        weights: importance of the parameters, if it was computed.
    """
    return {
        "scenarios": tuned.spec.scenarios,
        "seeds": tuned.spec.seeds,
        "controller": tuned.spec.controller,
        "robot": tuned.spec.robot,
        "servo_profile": tuned.spec.servo_profile,
        "objectives": {o.name: o.unit for o in tuned.spec.figures},
        "trials": len(tuned.candidates),
        "start": _candidate(tuned.start),
        "chosen": _candidate(tuned.chosen),
        "front": [_candidate(c) for c in tuned.front],
        "importance": weights or {},
        "training": [asdict(case) for case in tuned.training],
        "held_out": [asdict(case) for case in tuned.held_out],
        "words": tuned.words,
        "settings": tuned.overrides,
        "about": tuned.spec.about,
        SPEC: msgspec.to_builtins(tuned.spec),
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "place": candidate.place,
        "values": candidate.values,
        "figures": candidate.figures,
        "stopped": candidate.stopped,
    }


def _settings(tuned: Tuned, candidate: Candidate) -> bytes:
    """A file for ``--settings``: all values that are not defaults, with a comment."""
    spec = tuned.spec
    tuning = overrides_of(spec.parameters, candidate.values, start=spec.settings)
    settings = resolve_settings(None, overrides=[*spec.base, *tuning])
    plain = msgspec.to_builtins(ControllerSettings())
    table = {
        section: {k: _one(v) for k, v in values.items() if v != plain[section][k]}
        for section, values in msgspec.to_builtins(settings).items()
    }
    names = [Path(name).stem for name in spec.scenarios]
    seeds = ", ".join(map(str, spec.seeds))
    heading = [
        f"Trial {candidate.place} of a search on {', '.join(names)}, seeds {seeds},",
        f"with servo profile {spec.servo_profile}. All else is as by default.",
        *(tuned.words if candidate is tuned.chosen else []),
    ]
    lines = "".join(f"# {line}\n" for line in heading)
    text = tomli_w.dumps({k: v for k, v in table.items() if v})
    return f"{lines}\n{text}".encode()


def _one(value: Any) -> Any:
    """Reduce equal numbers of all axes to a single one."""
    alike = isinstance(value, (list, tuple)) and len(set(value)) == 1
    return value[0] if alike else value


def _trials(tuned: Tuned) -> Iterator[list[Any]]:
    names = [p.name for p in tuned.spec.parameters]
    units = [f"{o.name} [{o.unit}]" for o in tuned.spec.figures]
    yield ["trial", *names, *units, "runs", "stopped"]
    for c in tuned.candidates:
        values = [c.values[name] for name in names]
        yield [c.place, *values, *c.figures, len(c.rows), c.stopped]


def _values(tuned: Tuned, weights: dict[str, dict[str, float]]) -> dict[str, Any]:
    spec = tuned.spec
    drawings = [draw_front(tuned), *([draw_importance(weights)] if weights else [])]
    stopped = [c.stopped for c in tuned.candidates if c.stopped]
    worse = sum(why.startswith("worse") for why in stopped)
    return {
        "words": tuned.words,
        "scenarios": spec.scenarios,
        "seeds": spec.seeds,
        "spec": spec,
        "trials": len(tuned.candidates),
        "fell": len(stopped) - worse,
        "worse": worse,
        "drawings": [inline_svg(svg) for svg in drawings],
        "figures": list(map(_label, spec.figures)),
        "parameters": [f"{p.name} [{p.unit or '1'}]" for p in spec.parameters],
        "front": [_row(tuned, c) for c in (tuned.start, *tuned.front)],
        "seen": tuned.seen,
        "comparisons": {
            "On what the search has not seen": _cases(tuned.held_out),
            "On what it was trained on": _cases(tuned.training),
        },
        "settings": _settings(tuned, tuned.chosen).decode(),
    }


def _row(tuned: Tuned, candidate: Candidate) -> list[str]:
    marks = {tuned.chosen.place: " (chosen)", tuned.start.place: " (start)"}
    return [
        f"{candidate.place}{marks.get(candidate.place, '')}",
        *(value_text(figure) for figure in candidate.figures),
        *(value_text(candidate.values[p.name]) for p in tuned.spec.parameters),
    ]


def _cases(comparisons: Sequence[Comparison]) -> list[list[str]]:
    def pair(comparison: Comparison, index: int) -> str:
        sides = (comparison.before, comparison.after)
        old, new = ("-" if s is None else value_text(s[index]) for s in sides)
        return f"{old} → {new}"

    return [
        [
            Path(c.case).stem,
            f"{c.up[0]} → {c.up[1]} of {c.runs}",
            *(pair(c, i) for i in range(len(c.before or c.after or []))),
        ]
        for c in comparisons
    ]
