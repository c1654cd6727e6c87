"""``surefoot tune`` as a process: interrupted, resumed and refused."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import pytest

from surefoot.tuning.trials import Trials
from tests.command import Surefoot, command, environment, run_surefoot
from tests.support import PATIENCE_S, wait_until
from tests.surefoot.tuning.searches import HOLDS, still

PLACES = 60


def tune(folder: Path, *more: object) -> list[object]:
    search = ["--params", "tsid.com_kp=10:80", "--controller", HOLDS]
    return ["tune", still(folder), *search, "--out", folder / "out", *more]


@pytest.mark.process
def test_ctrl_c_ends_with_what_is_there_and_the_same_command_goes_on(
    tmp_path: Path,
) -> None:
    journal = tmp_path / "search.journal"
    words = tune(tmp_path, "--storage", journal, "--workers", 1, "--json")
    with subprocess.Popen(
        command(*words, "--trials", PLACES),
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        wait_until(lambda: journal.is_file() and finished(journal) > 2, what="trials")
        process.send_signal(signal.SIGINT)
        told, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, said
    outcome = json.loads(told)
    before = outcome["trials"]
    assert 2 < before < PLACES
    assert outcome["held_out"] == []
    assert "Traceback" not in said
    made = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"settings.toml", "index.html", "trials.csv"} <= made
    again = run_surefoot(*words, "--trials", before)
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["trials"] == before


def finished(journal: Path) -> int:
    return len(Trials(journal).finished())


def test_what_cannot_be_searched_is_a_usage_error_before_anything_runs(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    done = surefoot_here(*tune(tmp_path, "--sampler", "cma"))
    assert done.returncode == 2
    assert "expected tpe or nsga2" in done.stderr
    done = surefoot_here(*tune(tmp_path, "--held-out-seeds", ""))
    assert done.returncode == 2
    assert "--held-out-seeds: is empty; name a value" in done.stderr
    assert not (tmp_path / "out").exists()


def test_users_files_stay_though_there_is_a_journal_elsewhere(tmp_path: Path) -> None:
    journal = tmp_path / "search.journal"
    words = ["--storage", journal, "--workers", 1, "--trials", 1]
    first = run_surefoot(*tune(tmp_path, *words))
    assert first.returncode == 0, first.stderr
    mine = tmp_path / "mine"
    (mine / "front").mkdir(parents=True)
    files = [mine / "settings.toml", mine / "front" / "trial-best.toml"]
    for file in files:
        file.write_text("MINE")
    again = run_surefoot(*tune(tmp_path, *words, "--out", mine))
    assert again.returncode == 2
    assert "holds something else" in again.stderr
    assert [file.read_text() for file in files] == ["MINE", "MINE"]
