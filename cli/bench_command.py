"""``surefoot bench``: published benchmarks for robots and people."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from surefoot.cli import options

if TYPE_CHECKING:
    from rich.console import RenderableType

    from surefoot.bench.bench_files import Findings, TextTable

bench = typer.Typer(
    name="bench",
    cls=options.Group,
    no_args_is_help=True,
    help="Published benchmarks for robots and people.",
)
QuickOption = Annotated[
    bool,
    typer.Option(
        "--quick",
        help="A short version of some minutes: fewer cases, controllers and servos.",
    ),
]
ControllersOption = Annotated[
    str | None,
    typer.Option(
        "--controllers",
        metavar="NAMES",
        help="Comma-separated: whole-body, person, zmp-tuned, zmp-stock, paper, hold.",
    ),
]
ServosOption = Annotated[
    str | None,
    typer.Option(
        "--servo-profile",
        metavar="NAMES",
        help="Comma-separated profiles of the robot file; all of them when absent.",
    ),
]
OutOption = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder of runs, page and YAML files; an unfinished study is resumed.",
    ),
]


@bench.command(cls=options.Command)
def comtest(
    quick: QuickOption = False,
    out: OutOption = Path("out/comtest"),
    controllers: ControllersOption = None,
    servo_profiles: ServosOption = None,
    protocols: Annotated[
        str,
        typer.Option(metavar="NAMES", help="Comma-separated: transient, sinus, prts."),
    ] = "transient,sinus,prts",
    axes: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Comma-separated: pitch, roll, x, y; all when absent.",
        ),
    ] = None,
    sizes_deg: Annotated[
        str | None,
        typer.Option(
            "--sizes",
            metavar="DEG",
            help="Comma-separated, ascending, 45 at most; 0.5 to 16 when absent. A "
            "translation "
            "moves the ground as far as that tilt would move a stiff body.",
        ),
    ] = None,
    speed: Annotated[
        float,
        typer.Option(help="Speed of the ternary sequence; 5: five times as fast."),
    ] = 1.0,
    cycles: Annotated[
        int,
        typer.Option(
            min=3, help="Cycles of the ternary sequence; the first is not evaluated."
        ),
    ] = 3,
    robot: options.RobotOption = "walker",
    overrides: options.SetOption = None,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Run COMTEST: steps, sines and a ternary sequence of the ground.

    Compares the robot with people. Writes gain, phase and coherence at eleven
    frequencies with 95 % bands, the score D against 113 trials of people, and figures
    of steps, to OUT/index.html, comtest.json and EUROBENCH's YAML files. A full run
    takes hours. The same command resumes an interrupted one.
    """
    from surefoot.bench import comtest as measure
    from surefoot.cli.console import count_bar

    found = measure(
        robot,
        quick=quick,
        controllers=options.names_in(controllers),
        servo_profiles=options.names_in(servo_profiles),
        protocols=options.names_in(protocols),
        axes=options.names_in(axes),
        sizes_deg=_numbers(sizes_deg, option="--sizes"),
        speed=speed,
        cycles=cycles,
        settings=_settings(overrides),
        jobs=jobs,
        scheduler=scheduler,
        out=out,
        bar=count_bar,
    )
    _show(found, as_json=as_json)


@bench.command(cls=options.Command)
def dysturbance(
    quick: QuickOption = False,
    out: OutOption = Path("out/dysturbance"),
    controllers: ControllersOption = None,
    servo_profiles: ServosOption = None,
    kinds: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help="Comma-separated: impulse, sine-displacement, sine-force, "
            "slow-displacement, slow-force.",
        ),
    ] = "impulse,sine-displacement,sine-force,slow-displacement,slow-force",
    directions_deg: Annotated[
        str | None,
        typer.Option(
            "--directions",
            metavar="DEG",
            help="Comma-separated: 0 ahead, 90 left; 0,180,90 when absent.",
        ),
    ] = None,
    frequencies_hz: Annotated[
        str | None,
        typer.Option(
            "--frequencies",
            metavar="HZ",
            help="Frequencies of the sines, comma-separated; 0.5,1,2,4 when absent.",
        ),
    ] = None,
    body: Annotated[
        str | None,
        typer.Option(metavar="LINK", help="Link that is pushed; the base when absent."),
    ] = None,
    robot: options.RobotOption = "walker",
    overrides: options.SetOption = None,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Run DYSTURBANCE: find the largest pushes that the robot stands.

    The pushes are impulses, sines and slow ones. Each margin is found by bisection to
    within 2 %. Absorbed energy and equivalent impedance are scaled to a person, so that
    robots can be compared. Writes OUT/index.html, dysturbance.json and EUROBENCH's YAML
    files. A full run takes hours. The same command resumes an interrupted one.
    """
    from surefoot.bench import dysturbance as measure
    from surefoot.cli.console import count_bar

    found = measure(
        robot,
        quick=quick,
        controllers=options.names_in(controllers),
        servo_profiles=options.names_in(servo_profiles),
        kinds=options.names_in(kinds),
        directions_deg=_numbers(directions_deg, option="--directions"),
        frequencies_hz=_numbers(frequencies_hz, option="--frequencies"),
        body=body,
        settings=_settings(overrides),
        jobs=jobs,
        scheduler=scheduler,
        out=out,
        bar=count_bar,
    )
    _show(found, as_json=as_json)


def _show(found: Findings[Any], *, as_json: bool) -> None:
    from surefoot.cli.console import print_json, print_note, print_table

    if as_json:
        print_json(found.as_dict())
        return
    print_table(_tables(found.tables()))
    if found.folder is not None:
        print_note(f"open {found.folder / 'index.html'}")


def _numbers(text: str | None, *, option: str) -> list[float] | None:
    """Read a comma-separated list of numbers; None stays None.

    Raises:
        UsageError: the text is no such list.
    """
    from surefoot.errors import UsageError

    if text is None:
        return None
    try:
        return [float(number) for number in text.split(",")]
    except ValueError as error:
        raise UsageError(
            f"{option} {text!r}: expected numbers with commas between, such as 2,8"
        ) from error


def _settings(overrides: Iterable[str] | None) -> dict[str, Any]:
    from surefoot.schemas.toml_file import parse_override

    return dict(parse_override(text, option="--set") for text in overrides or ())


def _tables(tables: Iterable[TextTable]) -> RenderableType:
    from rich.console import Group

    from surefoot.cli.console import new_table

    shown = []
    for table in tables:
        drawn = new_table(table.title, *table.columns)
        for row in table.rows:
            drawn.add_row(*row)
        shown.append(drawn)
    return Group(*shown)
