"""What several files of tests look at is made once, whichever worker asks first."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command import run_surefoot, scenario_file


def made_once(
    folders: pytest.TempPathFactory, name: str, make: Callable[[Path], object]
) -> Path:
    """A folder that all workers of these tests share, for tests that do not change it.

    Args:
        folders: where this worker keeps its own.
        name: of the folder.
        make: fills it; a failure is not kept, so the next who asks sees it, too.
    """
    own = folders.getbasetemp()
    place = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    folder, made = place / name, place / f"{name}.made"
    with (place / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            made.touch()
    return folder


def short_run(folders: pytest.TempPathFactory) -> Path:
    """A folder of a run of 300 ticks on the bus under the controller that holds."""

    def make(folder: Path) -> None:
        scenario = scenario_file(folder, 0.3, name="short")
        words = ("--controller", "hold", "--out", folder / "run")
        done = run_surefoot("run", scenario, *words)
        assert done.returncode == 0, done.stderr

    return made_once(folders, "short", make) / "run"
