"""``surefoot sweep``: many runs of scenarios, varied, over seeds and controllers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from surefoot.cli import options
from surefoot.cli.completion import complete_scenario

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
            help="Comma-separated: whole-body, paper, zmp-tuned, zmp-stock, hold.",
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
