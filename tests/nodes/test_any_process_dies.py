"""Any process of a run is killed or stopped at any moment.

Commands stay safe, no file is half-written, and the record can be read.
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

import surefoot as sf
from tests.command import command, cut_short, environment
from tests.patient_robot import patient_robot_file
from tests.support import PATIENCE_S, free_port, is_gone, ticks_on_disk, wait_until
from tests.surefoot.recording.mcap_reading import messages_of_cut_off

pytest.importorskip("viser", reason="the live page needs viser: pip install -e .[view]")

DURATION_S = 6.0
TRIALS = 20
PROCESSES = ("run", "robot", "stabilizer", "recorder", "view")
PERIOD_S = 1e-3
TOLERANCE_RAD = 1e-9
_PROCESS = re.compile(r"process (\d+)")


@pytest.mark.slow
@pytest.mark.parametrize("trial", range(TRIALS))
@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGSTOP], ids=["kill", "stop"])
def test_nothing_unsafe_nothing_half_written(
    tmp_path: Path, sent: signal.Signals, trial: int
) -> None:
    draw = random.Random(f"{sent}{trial}")
    victim, after = draw.choice(PROCESSES), draw.randrange(100, 4000)
    out = tmp_path / "run"
    pace: tuple[object, ...] = ("--lockstep",)
    if draw.random() < 0.5:  # and where peers meet that are not of one run
        place = f"tcp/127.0.0.1:{free_port()}"
        robot = patient_robot_file(tmp_path)
        pace = ("--realtime", "--robot", robot, "--listen", place)
    with subprocess.Popen(
        command(
            *("run", cut_short("moving-platform-slow", tmp_path, DURATION_S)),
            *("--out", out, "--view", "--view-port", free_port(), *pace),
        ),
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        try:
            wait_until(lambda: ticks_on_disk(out) >= after, what=f"tick {after}")
            children = ids_of(out)
            number = run.pid if victim == "run" else children[victim]
            os.kill(number, sent)
            if sent is signal.SIGSTOP:
                time.sleep(draw.uniform(0.02, 3.0))  # the fault itself
                os.kill(number, signal.SIGCONT)
            stdout, stderr = run.communicate(timeout=PATIENCE_S)
        finally:
            run.kill()
        wait_until(
            lambda: all(map(is_gone, children.values())), what="all children to end"
        )
    assert "Traceback" not in stderr, (victim, after)
    if victim in ("view", "recorder"):  # they look on
        assert run.returncode == 0, (stdout, stderr)
    if sent is signal.SIGKILL and victim in ("robot", "stabilizer"):
        assert run.returncode == 1, stdout
        assert f"{victim}: was ended by signal 9" in stderr
    all_files_are_whole(out)
    no_step_is_unsafe(out)


def ids_of(out: Path) -> dict[str, int]:
    """Return the process ids of a run's children by name."""

    def find() -> dict[str, int] | None:
        found = {}
        for name in PROCESSES[1:]:
            log = out / f"{name}.log"
            match = _PROCESS.search(log.read_text()) if log.exists() else None
            if match is None:
                return None
            found[name] = int(match[1])
        return found

    return wait_until(find, what="all processes to start")


def all_files_are_whole(out: Path) -> None:
    for path in out.iterdir():
        if path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".toml":
            tomllib.loads(path.read_text())
        elif path.name == "run.mcap":
            assert not sf.read_record(path).is_cut_off
        elif path.name == "run.mcap.partial":
            heard = messages_of_cut_off(path)
            ticks = [m.content["tick"] for m in heard if m.channel == "joints"]
            assert ticks == sorted(set(ticks))
    if (out / "result.json").exists():
        loaded = sf.load_run(out)
        assert loaded.signals.count == loaded.result.ticks


def no_step_is_unsafe(out: Path) -> None:
    """Check that commands never jumped faster than a joint may turn."""
    commands = sf.read_signals(out)["q_command"]
    commands = commands[np.isfinite(commands).all(axis=1)]
    robot = sf.load_robot("walker")
    largest = np.abs(np.diff(commands, axis=0)).max(axis=0)
    assert (largest <= robot.velocity_limit * PERIOD_S + TOLERANCE_RAD).all()
