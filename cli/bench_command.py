"""``surefoot bench``: benchmarks that others measure robots and people by."""

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
    help="Measure a robot as others measure robots and people.",
)
QuickOption = Annotated[
    bool,
    typer.Option(
        "--quick", help="Some minutes of it: fewer cases, controllers and servos."
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
        help="Comma-separated, of the robot file; all it has when not given.",
    ),
]
OutOption = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder of runs, page and YAML files; a former one goes on.",
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
            help="Comma-separated: pitch, roll, x, y; all when not given.",
        ),
    ] = None,
    sizes_deg: Annotated[
        str | None,
        typer.Option(
            "--sizes",
            metavar="DEG",
            help="Comma-separated, from lowest to highest; 0.5 to 16 when not given. A "
            "translation goes as far as such a tilt moves a stiff body.",
        ),
    ] = None,
    speed: Annotated[
        float, typer.Option(help="Of the ternary sequence; 5 is five times as fast.")
    ] = 1.0,
    cycles: Annotated[
        int, typer.Option(min=3, help="Of the ternary sequence; the first is left out.")
    ] = 3,
    robot: options.RobotOption = "walker",
    overrides: options.SetOption = None,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """COMTEST: steps, sines and a ternary sequence of the ground, next to people.

    Gain, phase and coherence at eleven frequencies with 95 % bands, the score D against
    113 trials of people, figures of steps; OUT/index.html, comtest.json and EUROBENCH's
    YAML files. Whole, it takes hours; ended early, it goes on where it was.
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
            help="Comma-separated: 0 ahead, 90 left; 0,180,90 when not given.",
        ),
    ] = None,
    frequencies_hz: Annotated[
        str | None,
        typer.Option(
            "--frequencies",
            metavar="HZ",
            help="Of the sines, comma-separated; 0.5,1,2,4 when not given.",
        ),
    ] = None,
    body: Annotated[
        str | None,
        typer.Option(metavar="LINK", help="What is pushed; the base when not given."),
    ] = None,
    robot: options.RobotOption = "walker",
    overrides: options.SetOption = None,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """DYSTURBANCE: the largest strikes, swings and slow pushes that a robot stands.

    Margins by halving, to within 2 %, energy taken up and equivalent impedance, put in
    proportion to a person so that robots compare; OUT/index.html, dysturbance.json and
    EUROBENCH's YAML files. Whole, it takes hours; ended early, it goes on where it was.
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
    """Read a list of numbers.

    Raises:
        UsageError: it is none.
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
