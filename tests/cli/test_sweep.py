"""``surefoot sweep`` as a process: real runs, interrupted and resumed."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from surefoot.studies.store import RUNS, read_rows
from tests.command import Surefoot, command, environment, run_surefoot, scenario_file
from tests.support import wait_until

NOISE = "[sensors]\nforce_noise_n = 2.0\n"


def scenario(folder: Path, more: str = "") -> Path:
    return scenario_file(folder, 0.4, name="short", more=more + NOISE)


def sweep(folder: Path, *more: object) -> list[object]:
    varied = ["--vary", "friction=0.5,0.9", "--seeds", "0:2", "--jobs", 2]
    return ["sweep", scenario(folder), *varied, "--out", folder / "out", *more]


def test_sweep_gives_the_runs_that_run_gives(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    done = run_surefoot(*sweep(tmp_path, "--json"))
    assert done.returncode == 0, done.stderr
    groups: list[dict[str, Any]] = json.loads(done.stdout)
    assert [(g["values"], g["runs"], g["up"]) for g in groups] == [
        ({"friction": 0.5}, 2, 2),
        ({"friction": 0.9}, 2, 2),
    ]
    single = scenario(tmp_path, "friction = 0.9\n")
    alone = json.loads(
        surefoot_here("run", single, "--inline", "--seed", 1, "--json").stdout
    )
    (same,) = (
        row
        for row in read_rows(tmp_path / "out")
        if row["seed"] == 1 and row["values"] == {"friction": 0.9}
    )
    assert same["log_sha256"] == alone["log_sha256"]
    written = {path.suffix for path in (tmp_path / "out").iterdir()}
    assert {".csv", ".json", ".svg"} <= written


def test_killed_sweep_goes_on_where_it_was(tmp_path: Path) -> None:
    runs = tmp_path / "out" / RUNS
    words = command(*sweep(tmp_path, "--seeds", "0:40"))
    process = subprocess.Popen(words, env=environment())
    wait_until(
        lambda: runs.is_file() and len(runs.read_bytes().splitlines()) >= 2,
        what="two runs",
    )
    assert process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = {row["key"]: row for row in read_rows(tmp_path / "out")}
    done = run_surefoot(*sweep(tmp_path, "--jobs", 1))
    assert done.returncode == 0, done.stderr
    after = {row["key"]: row for row in read_rows(tmp_path / "out")}
    assert before.items() <= after.items()


def test_unknown_path_is_a_usage_error_before_anything_runs(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    done = surefoot_here(
        "sweep", "standing", "--vary", "frction=1", "--out", tmp_path / "out"
    )
    assert done.returncode == 2
    assert "friction" in done.stderr
    assert not list(read_rows(tmp_path / "out"))


def test_a_refused_sweep_leaves_nothing(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    words = ("--vary", "friction=nan,1", "--out", tmp_path / "out")
    done = surefoot_here("sweep", scenario(tmp_path), *words)
    assert done.returncode == 2
    assert "friction: got nan" in done.stderr
    assert not (tmp_path / "out").exists()


def test_settings_are_varied_as_scenario_values_are(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    varied = ["--vary", "dik.stance_leak=1,2", "--seeds", "1"]
    words = ["sweep", scenario(tmp_path), *varied, "--out", tmp_path / "out"]
    assert surefoot_here(*words).returncode == 0
    rows = sorted(
        read_rows(tmp_path / "out"), key=lambda row: row["values"]["dik.stance_leak"]
    )
    assert [row["values"] for row in rows] == [
        {"dik.stance_leak": 1},
        {"dik.stance_leak": 2},
    ]
    alone = surefoot_here(
        *("run", scenario(tmp_path), "--inline", "--seed", 1, "--json"),
        *("--set", "dik.stance_leak=2"),
    )
    assert rows[1]["log_sha256"] == json.loads(alone.stdout)["log_sha256"]
    assert rows[0]["log_sha256"] != rows[1]["log_sha256"]
    for name, said in (
        ("dik.stance_lek", "did you mean 'dik.stance_leak'?"),
        ("zmp.com_weight", "would not read it"),
        ("dik.k_force", "--vary: dik.k_force[0]: got 1"),
    ):
        done = surefoot_here(
            *words[:2], "--vary", f"{name}=1,2", "--out", tmp_path / "x"
        )
        assert done.returncode == 2
        assert said in done.stderr
    done = surefoot_here(*words, "--set", "dik.stance_leak=3")
    assert done.returncode == 2
    assert "--vary dik.stance_leak: --set gives it, too" in done.stderr


def test_seeds_without_noise_are_one_sample(tmp_path: Path) -> None:
    quiet = scenario_file(tmp_path, 0.1, name="quiet")
    done = run_surefoot(
        "sweep", quiet, "--seeds", "0:3", "--out", tmp_path / "out", "--json"
    )
    assert done.returncode == 0, done.stderr
    (group,) = json.loads(done.stdout)
    assert (group["runs"], group["up"]) == (3, 3)
    assert group["up_from"] == pytest.approx(0.2065, abs=1e-4)  # Wilson, 1 of 1
    assert "quiet.toml: seeds give the same run" in done.stderr
