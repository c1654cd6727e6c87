"""``surefoot report``: a page about runs that are over."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from surefoot.cli import options

NEEDED = ("viser", "yourdfpy", "plotly")


def report(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN_DIR",
            help="Folders that `surefoot run --out` left; several are compared.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of the page, new or empty. By default `report` in the run's "
            "folder, or beside the first of several.",
        ),
    ] = None,
    overwrite: options.OverwriteOption = False,
    video: Annotated[
        bool,
        typer.Option(
            "--video",
            help="Also an mp4 and a still of each run; needs OpenGL without a window "
            "and the extra `video`.",
        ),
    ] = False,
    animation: Annotated[
        bool,
        typer.Option(
            "--animation",
            help="Also some seconds of each run as an endless WebP; needs OpenGL "
            "without a window.",
        ),
    ] = False,
    open_browser: Annotated[
        bool, typer.Option("--open", help="Open the page in the web browser.")
    ] = False,
) -> None:
    """Write a page about runs: plots, 3-D replay, figures, settings, logs.

    The page is one folder that opens offline and can be sent as it is.
    """
    from importlib.util import find_spec

    from surefoot.cli.console import count_bar, print_text
    from surefoot.errors import EnvironmentFailedError
    from surefoot.installation import install_command

    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise EnvironmentFailedError(
            f"a report needs {', '.join(missing)}, not installed here; "
            f"{install_command('view')}"
        )
    from surefoot.report.video import check_drawing, load_drawing

    if video or animation:
        load_drawing()  # before the simulator is loaded for anything else
    from surefoot.report.run_data import load_runs

    loaded = load_runs(runs)
    folder = out or (runs[0] if len(runs) == 1 else runs[0].parent) / "report"
    if video or animation:
        check_drawing(loaded[0], video=video)
    from surefoot.report.page import write_report  # heavy: errors come first

    write_report(
        loaded,
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
