"""``surefoot margins`` and ``tune``: stability margins, and search for settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from surefoot.cli import options
from surefoot.cli.options import complete_scenario
from surefoot.errors import TuneInterrupted, UsageError

if TYPE_CHECKING:
    from rich.table import Table

    from surefoot.stabilizer.margins.margins import LoopMargins
    from surefoot.tuning.ask import Sampler

_SEARCH = "Search"
_SAMPLERS = ("tpe", "nsga2")


def margins(
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    settings: options.SettingsOption = None,
    overrides: options.SetOption = None,
    delay_ms: Annotated[
        float | None,
        typer.Option(
            "--delay",
            metavar="MS",
            help="Delay of the loop, from a reading to the tick in which its command "
            "acts; one tick of the robot when absent.",
        ),
    ] = None,
    as_json: options.JsonOption = False,
) -> None:
    """Compute the whole-body stabilizer's gain, phase and delay margins.

    They follow from robot file, servo profile and settings; nothing is simulated.
    """
    from surefoot.cli.console import print_json, print_table, print_text
    from surefoot.controllers import compute_margins
    from surefoot.run_plan import resolve_settings
    from surefoot.stabilizer.factory import check_read

    check_read(overrides or (), ["whole-body"])
    found = compute_margins(
        robot,
        servo_profile=servo_profile,
        settings=resolve_settings(
            settings, overrides=overrides or (), reader="whole-body"
        ),
        delay_ms=delay_ms,
    )
    if as_json:
        print_json(found)
        return
    print_table(margins_table(found))
    for line in found.in_words():
        print_text(line)


def margins_table(found: LoopMargins) -> Table:
    """Return a table with a row for each axis of each foot."""
    from surefoot.cli.console import new_table
    from surefoot.schemas.reasons import given

    table = new_table(
        f"{found.robot}, {found.servo_profile}, {found.rate_hz:g} Hz, loop of "
        f"{found.delay_ms:g} ms",
        *("foot", "axis"),
        figures=("gain, dB", "phase, deg", "delay, ms"),
    )
    for axis in found.axes:
        table.add_row(
            axis.foot,
            axis.axis,
            given(axis.gain_db, ".1f"),
            given(axis.phase_deg, ".0f"),
            given(axis.delay_ms, ".1f"),
            end_section=axis.axis == "yaw",
        )
    return table


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
            help="Setting to search, or one axis of it (dik.k_force.z). SETTING=A,B,C "
            "is a choice; SETTING alone uses its full range. May be repeated.",
        ),
    ],
    trials: Annotated[
        int,
        typer.Option("--trials", min=1, help="Number of trials, former ones included."),
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
            help="Journal of the search; DIR/trials.journal when absent. An existing "
            "one is continued, and several commands may share one.",
        ),
    ] = None,
    objectives: Annotated[
        str,
        typer.Option(
            "--objectives",
            help="Figures to minimise, comma-separated: com, com-max, force, peak, "
            "tilt, dcm, effort, score (D of COMTEST), margin. The robot must stay up.",
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
            help="Scenario to test start and result on at the end. May be repeated. "
            "When absent: the training scenarios with other seeds.",
        ),
    ] = None,
    held_out_seeds: Annotated[
        str | None, typer.Option("--held-out-seeds", help="Same form as --seeds.")
    ] = None,
    sampler: Annotated[
        str, typer.Option("--sampler", help="tpe or nsga2.", rich_help_panel=_SEARCH)
    ] = "tpe",
    sampler_seed: Annotated[
        int,
        typer.Option(
            "--sampler-seed",
            help="The same seed gives the same search, with one worker.",
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
    """Search settings that keep the robot up and minimise figures of its runs.

    Any process may be killed; the same command continues the search, and no finished
    trial is lost. At the end OUT holds settings.toml for --settings, all trials, and
    index.html with the trade-offs and the changes.
    """
    from surefoot.cli.console import count_bar, show_notes
    from surefoot.cli.study_commands import parse_seeds
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
            objectives=options.names_in(objectives),
            seeds=parse_seeds(seeds),
            held_out=held_out or [],
            held_out_seeds=None
            if held_out_seeds is None
            else parse_seeds(held_out_seeds, option="--held-out-seeds"),
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
    """Print the result; of an interrupted search what it has found so far."""
    from surefoot.cli.console import print_json, print_note, print_text
    from surefoot.tuning.outcome import Tuned
    from surefoot.tuning.page import as_dict

    if not isinstance(tuned, Tuned):
        print_note("no trial has finished; the same command continues the search")
        return
    if as_json:
        print_json(as_dict(tuned))
        return
    for sentence in tuned.words:
        print_text(sentence)
    print_note(f"--settings {out / 'settings.toml'}; open {out / 'index.html'}")
