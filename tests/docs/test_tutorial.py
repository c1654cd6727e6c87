"""Every command of the tutorial is run, in order, in an empty folder.

``make demo`` and the activation of the environment are left out, but the command of the
demo is run. Scenarios are shortened to little more than one second.
"""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from surefoot.cli.app import app
from surefoot.errors import ExitCode
from surefoot.sim_robot.catalogue import find_scenario
from tests.command import Surefoot, run_surefoot

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
ROW = re.compile(r"^│ (.+?)  ", re.MULTILINE)
"""Name of a row in a table on the page."""
BLOCK = re.compile(r"^```(sh|toml|text)\n(.*?)^```", re.DOTALL | re.MULTILINE)
SCENARIO_FILE = "my-seesaw.toml"
PUSH = "force_n = [0.0, 150.0, 0.0]"
SHIPPED = "moving-platform-slow"
LASTS = re.compile(r"^duration_s = .*$", re.MULTILINE)
SHORT_S = 1.2
"""Longer than one second, since errors count from there, when the ground moves."""
MADE_BEFORE = ("make demo", "source .venv/bin/activate")


def blocks(language: str) -> list[str]:
    return [text for kind, text in BLOCK.findall(PAGE) if kind == language]


def commands() -> list[list[str]]:
    """Return every command as a list of words."""
    lines = [line for text in blocks("sh") for line in text.splitlines()]
    return [shlex.split(line) for line in lines if line not in MADE_BEFORE]


@pytest.fixture
def folder(tmp_path: Path, surefoot_here: Surefoot) -> Path:
    """Return the folder in which the commands run one after the other."""
    del surefoot_here  # works in the same folder, which it has made
    work = tmp_path / "work"
    (scenario,) = blocks("toml")
    shipped = find_scenario(SHIPPED).read_text(encoding="utf-8")
    for name, text in ((SCENARIO_FILE, scenario), (f"{SHIPPED}.toml", shipped)):
        shorter = LASTS.sub(f"duration_s = {SHORT_S}", text, count=1)
        (work / name).write_text(shorter, encoding="utf-8")
    return work


def run(folder: Path, words: list[str]) -> subprocess.CompletedProcess[str]:
    assert words[0] == "surefoot"
    return run_surefoot(*words[1:], cwd=folder)


def known() -> set[str]:
    """Return the names of all commands."""
    names = {
        c.name or getattr(c.callback, "__name__", "") for c in app.registered_commands
    }
    return names | {group.name or "" for group in app.registered_groups}


def check_command(folder: Path, words: list[str], surefoot_here: Surefoot) -> str:
    """Run a command as the reader would; return its output."""
    assert words[1] in known()
    if "--view" in words:
        pytest.importorskip("viser")
        words = [*words, "--view-port", "0"]
    words = [f"{word}.toml" if word == SHIPPED else word for word in words]
    looks_only = words[1] in ("scenarios", "log")
    done = surefoot_here(*words[1:]) if looks_only else run(folder, words)
    told = f"{shlex.join(words)}: {done.stderr}"
    if "--realtime" in words and done.returncode != ExitCode.OK:
        # Answered too late, the robot holds, stops in a fault or falls, and says why.
        assert done.returncode in (ExitCode.FAILED, ExitCode.FELL), told
        assert "machine too slow" in done.stdout
    else:
        assert done.returncode == ExitCode.OK, told
        assert words[1] != "run" or "stood" in done.stdout
    if "--out" in words:
        assert (folder / words[words.index("--out") + 1]).is_dir()
    if "--view" in words:
        assert "live page: http://127.0.0.1:" in done.stderr
    return done.stdout


def test_the_demo_is_what_make_demo_runs() -> None:
    done = subprocess.run(
        ["make", "--dry-run", "--always-make", "demo"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "surefoot run moving-platform-slow --out out/demo" in done.stdout
    assert "make demo" in PAGE


def test_each_command_does_what_it_should(
    folder: Path, surefoot_here: Surefoot
) -> None:
    """One test, since each command needs what those before it have left."""
    told = "".join(check_command(folder, words, surefoot_here) for words in commands())
    rows = ROW.findall("".join(blocks("text")))
    assert len(rows) > 5
    assert {row for row in rows if f"│ {row} " not in told} == set()
    there = {path.name for path in (folder / "out/mine").iterdir()}
    named = {"result.json", "ticks.mcap", "run.mcap", "settings.toml", "scenario.toml"}
    assert named <= there
    for name in ("result.json", "ticks.mcap", "run.mcap"):
        assert f"`{name}`" in PAGE


def test_a_hard_push_makes_the_robot_fall(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    (scenario,) = blocks("toml")
    assert "900 N" in PAGE
    assert PUSH in scenario
    harder = scenario.replace(PUSH, PUSH.replace("150.0", "900.0"))
    path = tmp_path / "harder.toml"
    path.write_text(harder, encoding="utf-8")
    done = surefoot_here("run", path, "--inline")
    assert done.returncode == 5, done.stderr
    assert "fell" in done.stdout
