"""``surefoot reproduce``: the paper's evaluation in one command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surefoot.cli import options


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
    from surefoot.studies.paper_figures import COMPARED, SHOWN, draw, record
    from surefoot.studies.paper_page import FIGURES, write_report
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
