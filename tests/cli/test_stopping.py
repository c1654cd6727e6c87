"""A run leaves no process behind, however it is ended."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.runs import load_run
from surefoot.schemas.reasons import Outcome
from tests.command import command, environment, scenario_file
from tests.support import PATIENCE_S, is_gone, ticks_on_disk, wait_until

_PROCESS = re.compile(r"process (\d+)")


@pytest.fixture
def endless_run(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Start a run of an hour; return it and the folder of its logs.

    It is started as from a terminal, even if the tests run under nohup.
    """
    scenario = scenario_file(tmp_path, 3600.0)
    folder = tmp_path / "out"
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    with subprocess.Popen(
        command("run", scenario, "--controller", "hold", "--out", folder / "run"),
        env=environment(),
        cwd=tmp_path,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        signal.signal(signal.SIGHUP, before)
        yield process, folder
        process.kill()


def children(folder: Path) -> tuple[int, int]:
    """Return the process ids of robot and stabilizer, once both have started."""

    def active_ids() -> tuple[int, int] | None:
        ids = []
        for name in ("robot", "stabilizer"):
            text = "".join(path.read_text() for path in folder.rglob(f"{name}.log"))
            found = _PROCESS.search(text)
            if found is None:
                return None
            ids.append(int(found.group(1)))
        return ids[0], ids[1]

    return wait_until(active_ids, what="robot and stabilizer to start")


# SIGINT to such a run: test_out_folder.py. All take the same way.
def test_interrupting_a_run_stops_both_and_keeps_what_there_is(
    endless_run: tuple[subprocess.Popen[str], Path],
) -> None:
    process, folder = endless_run
    ids = children(folder)
    process.send_signal(signal.SIGHUP)
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in stderr
    assert ": SIGHUP" in stdout
    assert all(map(is_gone, ids))
    kept = {file.name for file in folder.rglob("*.log")}
    assert {"robot.log", "stabilizer.log"} <= kept
    assert not [*folder.rglob("*.partial")]


def test_nohup_keeps_a_command_from_ending_with_its_terminal() -> None:
    words = "from surefoot.schemas.reasons import SIGNALS; print(*SIGNALS)"
    done = subprocess.run(
        ["nohup", sys.executable, "-c", words],
        env=environment(),
        text=True,
        capture_output=True,
        check=True,
    )
    assert done.stdout.split() == [str(int(n)) for n in (signal.SIGINT, signal.SIGTERM)]


def test_children_end_when_their_parent_is_killed(
    endless_run: tuple[subprocess.Popen[str], Path],
) -> None:
    process, folder = endless_run
    ids = children(folder)
    process.kill()
    wait_until(lambda: all(map(is_gone, ids)), what="both children to end")


@pytest.mark.usual("1-stabilizer")
@pytest.mark.parametrize(("victim", "name"), [(0, "robot"), (1, "stabilizer")])
def test_a_killed_child_ends_the_run_and_is_named(
    endless_run: tuple[subprocess.Popen[str], Path], victim: int, name: str
) -> None:
    process, folder = endless_run
    ids = children(folder)
    if name == "stabilizer":
        wait_until(lambda: ticks_on_disk(folder / "run"), what="ticks on the disk")
    os.kill(ids[victim], signal.SIGKILL)
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    # Without the robot's side there is nothing to tell; without the other there is.
    assert ("interrupted at" in stdout) == (name == "stabilizer")
    assert "SIGTERM" not in stdout
    assert f"{name}: was ended by signal 9" in stderr
    assert all(map(is_gone, ids))
    if name == "stabilizer":
        kept = load_run(folder / "run")
        assert kept.outcome in (Outcome.HELD, Outcome.FAULT, Outcome.INTERRUPTED)
        assert kept.outcome in stdout
        assert kept.signals.count == kept.result.ticks
