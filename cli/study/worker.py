"""A worker process of a study: does runs as long as its parent lives."""

from __future__ import annotations

import os
import threading
import time
from functools import cache

from cli.study.cell import Cell
from cli.study.run_cell import Row, run_cell

LOOK_S = 0.5


def run_for(parent: int, cell: Cell, *, robot: str, overrides: tuple[str, ...]) -> Row:
    """Runs a cell as :func:`run_cell` does.

    Args:
        parent: id of the process that asks. A worker whose parent was killed ends
            itself in the middle of its run: nobody would get the result.
        cell: what to run.
        robot: shipped robot or a robot file.
        overrides: settings, ``section.name=value``.
    """
    if os.getpid() != parent:
        _end_with(parent)
    return run_cell(cell, robot=robot, overrides=overrides)


@cache
def _end_with(parent: int) -> None:
    """Watches the parent from now on; once a process."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_S)  # nothing tells a process that its parent has died
        os._exit(1)

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()
