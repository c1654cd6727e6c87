"""``surefoot tune``: a search for settings, by several processes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from surefoot.cli import options
from surefoot.cli.completion import complete_scenario
from surefoot.errors import TuneInterrupted, UsageError

if TYPE_CHECKING:
    from surefoot.tuning.spec import Sampler

_SEARCH = "Search"
_SAMPLERS = ("tpe", "nsga2")


def tune(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            help="Scenarios to train on: shipped names or paths.",
            autocompletion=complete_scenario,
        ),
    ],
    params: Annotated[
        list[str],
        typer.Option(
            "--params",
            metavar="SETTING=LOW:HIGH",
            help="Setting to search, or one axis of it (dik.k_force.z); SETTING=A,B,C "
            "for a choice, SETTING alone for as far as it allows. May be repeated.",
        ),
    ],
    trials: Annotated[
        int,
        typer.Option("--trials", min=1, help="How many, former ones included."),
    ] = 100,
    workers: Annotated[
        int,
        typer.Option("--workers", min=0, help="Processes; 0 for one per processor."),
    ] = 0,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of settings and page.")
    ] = Path("out/tune"),
    storage: Annotated[
        Path | None,
        typer.Option(
            "--storage",
            metavar="FILE",
            help="Journal of the search; an old one goes on, and several commands may "
            "work on one. DIR/trials.journal without this.",
        ),
    ] = None,
    objectives: Annotated[
        str,
        typer.Option(
            "--objectives",
            help="What to make small, comma-separated: com, com-max, force, peak, "
            "tilt, effort, score (D of COMTEST), margin. To stay up is a constraint.",
        ),
    ] = "com,force",
    seeds: Annotated[
        str, typer.Option("--seeds", help="FROM:TO or a list, such as 0:3.")
    ] = "0:1",
    held_out: Annotated[
        list[str] | None,
        typer.Option(
            "--held-out",
            metavar="SCENARIO",
            help="Scenario that only start and choice are run on, in the end. May be "
            "repeated; those trained on, with other seeds, without this.",
        ),
    ] = None,
    held_out_seeds: Annotated[
        str | None, typer.Option("--held-out-seeds", help="As --seeds.")
    ] = None,
    sampler: Annotated[
        str, typer.Option("--sampler", help="tpe or nsga2.", rich_help_panel=_SEARCH)
    ] = "tpe",
    sampler_seed: Annotated[
        int,
        typer.Option(
            "--sampler-seed",
            help="The same makes the same search, with one worker.",
            rich_help_panel=_SEARCH,
        ),
    ] = 0,
    controller: options.ControllerOption = "whole-body",
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    settings: options.SettingsOption = None,
    overrides: options.SetOption = None,
    scheduler: options.SchedulerOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Search settings that keep the robot up and make figures of its runs small.

    Any process may be killed and the search goes on with the same command; no finished
    trial is lost. In the end OUT holds settings.toml for --settings, index.html with
    what can be had and what changed, and all trials.
    """
    from surefoot.cli.console import count_bar, show_notes
    from surefoot.cli.sweep_cells import parse_seeds
    from surefoot.tuning.tune import tune as search

    if sampler not in _SAMPLERS:
        raise UsageError(f"--sampler {sampler}: expected {' or '.join(_SAMPLERS)}")
    show_notes("surefoot.tune")
    try:
        tuned = search(
            scenarios,
            params,
            trials=trials,
            workers=workers,
            storage=storage,
            out=out,
            objectives=objectives.split(","),
            seeds=parse_seeds(seeds),
            held_out=held_out or [],
            held_out_seeds=parse_seeds(held_out_seeds) if held_out_seeds else None,
            controller=controller,
            settings=settings,
            overrides=overrides or [],
            robot=robot,
            servo_profile=servo_profile,
            sampler=cast("Sampler", sampler),
            sampler_seed=sampler_seed,
            scheduler=scheduler,
            bar=count_bar,
        )
    except TuneInterrupted as interrupt:
        _tell(interrupt.tuned, out, as_json=as_json)
        raise
    _tell(tuned, out, as_json=as_json)


def _tell(tuned: object, out: Path, *, as_json: bool) -> None:
    """Print what came out; of a search that was broken off, as far as it came."""
    from surefoot.cli.console import print_json, print_note, print_text
    from surefoot.tuning.outcome import Tuned
    from surefoot.tuning.page import as_dict

    if not isinstance(tuned, Tuned):
        print_note("no trial was finished; the same command goes on")
        return
    if as_json:
        print_json(as_dict(tuned))
        return
    for sentence in tuned.words:
        print_text(sentence)
    print_note(f"--settings {out / 'settings.toml'}; open {out / 'index.html'}")
