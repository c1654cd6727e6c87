"""Makes what several test files use once, by the first worker that asks."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.command import run_surefoot, scenario_file
from tests.patient_robot import patient_robot_file


def made_once(
    folders: pytest.TempPathFactory, name: str, make: Callable[[Path], object]
) -> Path:
    """Return a folder that all workers share, for tests that do not change it.

    Args:
        folders: this worker's own folders.
        name: name of the folder.
        make: fills the folder; after a failure the next caller tries again.
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


def short_run(folders: pytest.TempPathFactory, mode: str = "lockstep") -> Path:
    """Return the folder of a run of 300 ticks that holds its posture.

    Its seed is 5, ``safety.leave_s`` is 0.06 s. Beside it are ``short.toml``, which was
    run, and ``told.json``, which the command printed.
    """

    def make(folder: Path) -> None:
        scenario = scenario_file(folder, 0.3, name="short")
        words: list[object] = ["--controller", "hold", "--json", f"--{mode}"]
        words += ["--seed", 5, "--set", "safety.leave_s=0.06"]
        if mode == "realtime":
            words += ["--robot", patient_robot_file(folder), "--realtime-priority", 20]
        done = run_surefoot("run", scenario, *words, "--out", folder / "run")
        assert done.returncode == 0, done.stderr
        (folder / "told.json").write_text(done.stdout)

    return made_once(folders, f"short {mode}", make) / "run"
