"""``surefoot sweep``, ``reproduce`` and ``report``: many runs, and pages on them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from surefoot.cli import options
from surefoot.cli.options import MOST_SEED, complete_scenario
from surefoot.errors import UsageError

OutOption = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder of the study; an unfinished one is resumed.",
    ),
]


def sweep(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            help="Shipped scenarios, or scenario files (.toml).",
            autocompletion=complete_scenario,
        ),
    ],
    out: OutOption,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            metavar="PATH=VALUES",
            help="Scenario value or setting to vary: A,B,C or FROM:TO:COUNT. When "
            "repeated, all combinations are run. Paths: friction, tilt_rate_deg_s, "
            "platform.0.motion.0.amplitude_deg, push.0.direction_deg, pace, "
            "tsid.com_kp, ...",
        ),
    ] = None,
    seeds: Annotated[
        str, typer.Option("--seeds", help="FROM:TO or a list, such as 0:50.")
    ] = "0:10",
    controllers: Annotated[
        str,
        typer.Option(
            "--controllers",
            help="Comma-separated: whole-body, person, paper, zmp-tuned, zmp-stock, "
            "hold.",
        ),
    ] = "whole-body",
    servo_profiles: Annotated[
        str | None,
        typer.Option(
            "--servo-profile",
            metavar="NAMES",
            help="Comma-separated profiles of the robot file; the file's own choice "
            "when absent.",
        ),
    ] = None,
    robot: options.RobotOption = "walker",
    overrides: options.SetOption = None,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Run all combinations in parallel, and count how many stayed up.

    Each finished run is kept in OUT/runs.jsonl, and the same command resumes an
    interrupted sweep. OUT/summary.csv and summary.json hold the figures. OUT also gets
    one plot of the success rate for each scenario and varied value.
    """
    from surefoot.cli.console import count_bar, print_json, print_table
    from surefoot.cli.summary import study_tables
    from surefoot.studies.study import make_cells, run_study
    from surefoot.studies.summaries import summary_rows

    cells = make_cells(
        scenarios,
        robot=robot,
        levels=[parse_vary(text) for text in vary or []],
        controllers=options.names_in(controllers),
        servo_profiles=options.names_in(servo_profiles),
        seeds=parse_seeds(seeds),
    )
    done = run_study(
        cells,
        out,
        robot=robot,
        overrides=tuple(overrides or []),
        jobs=jobs,
        scheduler=scheduler,
        bar=count_bar,
    )
    if as_json:
        print_json(summary_rows(done.summaries))
    else:
        print_table(study_tables(done.summaries))


def parse_seeds(text: str, *, option: str = "--seeds") -> Sequence[int]:
    """Parse seeds such as ``0:50`` (0 to 49) or ``1,4,7``.

    Raises:
        UsageError: the text has neither form.
    """
    first, colon, end = text.partition(":")
    seeds: Sequence[int] = []
    with suppress(ValueError):
        numbers = text.split(",")
        seeds = range(int(first), int(end)) if colon else sorted(map(int, numbers))
    if not seeds or seeds[0] < 0 or seeds[-1] > MOST_SEED:
        raise UsageError(
            f"{option} {text!r}: expected FROM:TO, such as 0:50 for 50 seeds, or a "
            f"list such as 1,4,7; from 0 to {MOST_SEED}"
        )
    return seeds


def parse_vary(text: str) -> list[tuple[str, Any]]:
    """Parse ``PATH=A,B,C``, or ``PATH=FROM:TO:COUNT`` for evenly spaced numbers.

    Raises:
        UsageError: the text has neither form.
    """
    from surefoot.schemas.toml_file import parse_value

    path, equals, values = text.partition("=")
    path = path.strip()
    if not equals or not values.strip():
        raise UsageError(
            f"--vary {text!r}: expected PATH=A,B,C or PATH=FROM:TO:COUNT, such as "
            "friction=0.4:1.0:7"
        )
    if values.count(":") == 2:
        return [(path, level) for level in _spaced(text, values)]
    what = f"--vary {path}"
    if values.lstrip().startswith("["):
        return [(path, each) for each in parse_value(f"[{values}]", what=what)]
    return [(path, parse_value(part, what=what)) for part in values.split(",")]


def _spaced(text: str, values: str) -> list[float]:
    from surefoot.studies.study import MOST_RUNS

    first, last, count = values.split(":")
    try:
        low, high, n = float(first), float(last), int(count)
    except ValueError:
        n = 0
    if not 2 <= n <= MOST_RUNS:
        raise UsageError(
            f"--vary {text!r}: expected numbers FROM:TO:COUNT with a count from 2 to "
            f"{MOST_RUNS}"
        )
    return [low + (high - low) * i / (n - 1) for i in range(n)]


def reproduce(
    out: OutOption = Path("out/reproduce"),
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="A few minutes: one seed, fewer rates, two controllers.",
        ),
    ] = False,
    seeds: Annotated[
        int | None,
        typer.Option("--seeds", min=1, help="Seeds per case instead of 50 (quick: 1)."),
    ] = None,
    report_only: Annotated[
        bool,
        typer.Option("--report-only", help="Write the page from finished runs only."),
    ] = False,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
) -> None:
    """Run the paper's scenarios with all controllers, and write a page about them.

    With 50 seeds it takes some six hours on two processors, with --quick less than
    five minutes. The same command resumes an interrupted study.
    """
    from surefoot.cli.console import count_bar, print_note
    from surefoot.out_folder import write_whole
    from surefoot.studies.execute import execute
    from surefoot.studies.paper import cells_of, extent
    from surefoot.studies.paper_page import (
        COMPARED,
        FIGURES,
        SHOWN,
        draw,
        record,
        write_report,
    )
    from surefoot.studies.store import StudyStore
    from surefoot.studies.summaries import summarise

    cells = cells_of(extent(quick=quick, seeds=seeds))
    with StudyStore(out, about={"study": "reproduce"}) as store:
        if not report_only:
            execute(
                cells,
                store,
                robot="walker",
                jobs=jobs,
                scheduler=scheduler,
                title="runs",
                bar=count_bar,
            )
            folder = out / FIGURES
            folder.mkdir(exist_ok=True)
            undrawn = [n for n in SHOWN if not (folder / f"{n}.svg").is_file()]
            with count_bar("figures", total=len(undrawn), done=0) as tell:
                for name in undrawn:
                    svg = draw(SHOWN[name], {v: record(name, v) for v in COMPARED})
                    write_whole(folder / f"{name}.svg", svg)
                    tell()
        rows = [store.rows[cell.key] for cell in cells if cell.key in store.rows]
        if not rows:
            raise UsageError(
                f"--out {out}: holds no finished runs to report; leave out "
                "--report-only, or name the folder that has them"
            )
        missing = len(cells) - len(rows)
        page = write_report(out, summarise(rows), about=store.about, missing=missing)
    print_note(f"{len(rows)} of {len(cells)} runs; open {page}")


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN_DIR",
            help="Folders of `surefoot run --out`, or a file in each. Several runs are "
            "compared.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="New or empty folder of the page. When absent: `report` in the run's "
            "folder, or beside the first of several.",
        ),
    ] = None,
    overwrite: options.OverwriteOption = False,
    video: Annotated[
        bool,
        typer.Option(
            "--video",
            help="Also make an mp4 and a still of each run. Needs OpenGL without a "
            "window and the extra `video`.",
        ),
    ] = False,
    animation: Annotated[
        bool,
        typer.Option(
            "--animation",
            help="Also make a looping WebP of some seconds of each run. Needs OpenGL "
            "without a window.",
        ),
    ] = False,
    open_browser: options.OpenOption = False,
) -> None:
    """Write a page about runs: plots, 3-D replay, figures, settings, logs.

    The page is one folder. It opens offline and can be sent to others.
    """
    from surefoot.cli.console import count_bar, print_text
    from surefoot.errors import EnvironmentFailedError
    from surefoot.installation import lacking

    if words := lacking("a report", "viser", "yourdfpy", "plotly", extra="view"):
        raise EnvironmentFailedError(words)
    from surefoot.report.video import load_drawing

    if video or animation:
        load_drawing()  # before the simulator is loaded for anything else
    from surefoot.report.page import write_report
    from surefoot.run_folder import folder_of_run

    folders = [folder_of_run(run) for run in runs]
    folder = out or (folders[0] if len(runs) == 1 else folders[0].parent) / "report"
    write_report(
        folders,
        folder,
        overwrite=overwrite,
        video=video,
        animation=animation,
        bar=count_bar,
    )
    page = folder / "index.html"
    print_text(str(page))
    if open_browser:
        typer.launch(page.resolve().as_uri())
