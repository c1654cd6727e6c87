"""Page and recorder are killed during a run; robot and stabilizer are not affected."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

from tests.command import Surefoot, command, cut_short, environment
from tests.support import PATIENCE_S, free_port, wait_until
from tests.surefoot.recording.mcap_reading import messages_of_cut_off

pytest.importorskip("viser", reason="the live page needs viser: pip install -e .[view]")

DURATION_S = 2.0
PROCESS = re.compile(r", process (\d+)")
WRITTEN_BYTES = 1_000_000
"""Bytes: more than attachments and schemas, so the run is under way."""


def process_of(log: Path) -> int | None:
    found = PROCESS.search(log.read_text()) if log.exists() else None
    return None if found is None else int(found.group(1))


def test_a_run_whose_page_and_recorder_are_killed_is_the_same_run(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    words = ("run", cut_short("moving-platform-fast", tmp_path, DURATION_S), "--json")
    bare = json.loads(surefoot(*words, "--inline").stdout)
    folder = tmp_path / "out"
    watched = subprocess.Popen(
        command(
            *(*words, "--view", "--view-port", free_port(), "--out", folder / "run")
        ),
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        partial = wait_until(
            lambda: next(folder.glob("run/run.mcap.partial"), None),
            what="the recorder",
        )
        wait_until(
            lambda: partial.exists() and partial.stat().st_size > WRITTEN_BYTES,
            what="the run to be under way",
        )
        for name in ("view", "recorder"):
            victim = process_of(partial.with_name(f"{name}.log"))
            assert victim is not None
            os.kill(victim, signal.SIGKILL)
        stdout, stderr = watched.communicate(timeout=PATIENCE_S)
    finally:
        watched.kill()
        watched.wait()
    assert watched.returncode == 0, stderr
    assert "recorder: was ended by signal 9; the run went on" in stderr
    told = json.loads(stdout)
    assert told["ticks"] == round(DURATION_S * 1000)
    assert (told["log_sha256"], told["fell"]) == (bare["log_sha256"], False)
    assert "live page: http://127.0.0.1:" in stderr
    assert not (folder / "run" / "run.mcap").exists()
    left = messages_of_cut_off(folder / "run" / "run.mcap.partial")
    ticks = [m.content["tick"] for m in left if m.channel == "joints"]
    assert 0 < len(ticks) < told["ticks"], "killed in the middle"
    assert ticks == list(range(len(ticks)))
