"""``surefoot sweep`` and ``reproduce``: many runs, and how many stayed up."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from surefoot.cli import options
from surefoot.cli.options import complete_scenario

Values = tuple[tuple[str, Any], ...]


def sweep(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            help="Shipped names or paths of scenario files.",
            autocompletion=complete_scenario,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", help="Folder of the study; a former one goes on."
        ),
    ],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            metavar="PATH=VALUES",
            help="Scenario value to vary: A,B,C or FROM:TO:COUNT. May be repeated: "
            "all combinations. Paths: friction, platform.0.motion.0.amplitude_deg, "
            "tilt_rate_deg_s, push.0.direction_deg, pace, ...",
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
        str,
        typer.Option("--servo-profile", help="Comma-separated, of the robot file."),
    ] = "ideal",
    robot: options.RobotOption = "walker",
    overrides: options.SetOption = None,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Run every combination in parallel processes, and say how many stayed up.

    Each finished run is kept in OUT/runs.jsonl; a sweep that was ended goes on where
    it was. OUT/summary.csv and summary.json hold the figures, one plot per scenario
    and varied value the success curve.
    """
    from surefoot.cli.console import count_bar, print_json, print_table
    from surefoot.cli.summary import study_tables
    from surefoot.cli.sweep_cells import all_cells, parse_seeds
    from surefoot.studies.study import run_study
    from surefoot.studies.tables import summary_rows

    cells = all_cells(
        scenarios,
        vary=vary or [],
        variants=controllers.split(","),
        servo_profiles=servo_profiles.split(","),
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


def reproduce(
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", help="Folder of the study; a former one goes on."
        ),
    ] = Path("out/reproduce"),
    quick: Annotated[
        bool,
        typer.Option("--quick", help="1 seed, fewer rates, two controllers: minutes."),
    ] = False,
    seeds: Annotated[
        int | None,
        typer.Option("--seeds", min=1, help="Seeds per case instead of 50 (quick: 1)."),
    ] = None,
    report_only: Annotated[
        bool, typer.Option("--report-only", help="Write the page from kept runs only.")
    ] = False,
    jobs: options.JobsOption = 0,
    scheduler: options.SchedulerOption = None,
) -> None:
    """Run the paper's scenarios with all controllers, and write a page about them.

    Whole, with 50 seeds, it takes some six hours on two processors; --quick takes
    less than five minutes. Ended early, it goes on where it was.
    """
    from surefoot.cli.console import count_bar, print_note
    from surefoot.robot_io.atomic_file import atomic_file
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
    from surefoot.studies.summary import summarise

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
                    with atomic_file(folder / f"{name}.svg") as file:
                        file.write(svg)
                    tell()
        rows = [store.rows[cell.key] for cell in cells if cell.key in store.rows]
        missing = len(cells) - len(rows)
        page = write_report(out, summarise(rows), about=store.about, missing=missing)
    print_note(f"{len(rows)} of {len(cells)} runs; open {page}")
