from __future__ import annotations

import re

import pytest
import typer
from typer.testing import CliRunner

from surefoot.cli.app import app
from surefoot.stabilizer.factory import shipped_settings
from tests.command import Surefoot, run_python

HEAVY = {
    "numpy",
    "mujoco",
    "pinocchio",
    "piqp",
    "zenoh",
    "scipy",
    "msgspec",
    "cryptography",
}
COMMANDS = (
    "run",
    "robot",
    "stabilizer",
    "record",
    "replay",
    "report",
    "log",
    "scenarios",
    "router",
    "relay",
    "certs",
    "check-robot",
    "tare",
    "new-robot",
    "check-robot-file",
)


@pytest.fixture
def surefoot(surefoot_here: Surefoot) -> Surefoot:
    return surefoot_here


SHOW_MODULES = """
import sys
from surefoot.cli.__main__ import main
try:
    main()
finally:
    print("MODULES", *sorted(sys.modules), file=sys.stderr)
"""


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"]])
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    done = run_python("-c", SHOW_MODULES, *arguments)
    assert done.returncode == 0, done.stderr
    (modules,) = (
        set(line.split()) for line in done.stderr.splitlines() if "MODULES" in line
    )
    assert "typer" in modules
    assert modules.isdisjoint(HEAVY)
    assert "Usage: surefoot" in done.stdout


def test_help_names_all_commands_and_exit_codes(surefoot: Surefoot) -> None:
    done = surefoot("--help")
    assert done.returncode == 0
    for word in (*COMMANDS, "4 robot unreachable", "130 interrupted"):
        assert word in " ".join(done.stdout.split())


def test_unknown_commands_and_options_are_usage_errors(surefoot: Surefoot) -> None:
    for arguments in (["stroll"], ["run", "standing", "--spede"]):
        done = surefoot(*arguments)
        assert done.returncode == 2
        assert arguments[-1] in done.stderr
        assert done.stdout == ""


def commands() -> list[tuple[str, ...]]:
    """Return all commands, including those below ``log``."""
    found: list[tuple[str, ...]] = [(), ("log",)]
    for name, command in typer.main.get_command(app).commands.items():
        below = getattr(command, "commands", None)
        found += [(name, each) for each in below] if below else [(name,)]
    return found


def test_a_home_folder_that_no_shell_expands_is_the_home_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("HOME", "/home/ann")
    report = typer.main.get_command(app).commands["report"]
    given = report.make_context("report", ["~/a", "./~", "x~", "--out=~/b"]).params
    assert [*map(str, given["runs"])] == ["/home/ann/a", "~", "x~"]
    assert str(given["out"]) == "/home/ann/b"


@pytest.mark.parametrize("words", commands(), ids=" ".join)
def test_every_command_explains_itself_as_a_terminal_does(
    surefoot: Surefoot, words: tuple[str, ...]
) -> None:
    done = surefoot(*words, "--help")
    assert done.returncode == 0
    assert " ".join(["Usage: surefoot", *words]) in done.stdout
    # Options for the processes among themselves are nobody's business.
    assert "--result-file" not in done.stdout
    assert "--child" not in done.stdout
    assert not re.search(r"<[a-z]+[\[> ]|[{}]|int range", done.stdout)


@pytest.mark.parametrize("columns", [50, 80])
def test_no_name_of_an_option_is_cut(columns: int) -> None:
    for words in commands():
        done = CliRunner().invoke(
            app,
            [*words, "--help"],
            env={"COLUMNS": str(columns)},
            terminal_width=columns,
        )
        assert done.exit_code == 0
        for line in done.output.splitlines():
            assert len(line) <= columns, words
            assert not re.match(r"\W*-\S*…", line), (words, line)


def test_help_names_all_settings_that_are_shipped() -> None:
    done = CliRunner().invoke(app, ["margins", "--help"], env={"COLUMNS": "400"})
    assert f"Shipped settings ({', '.join(shipped_settings())})" in done.stdout


def test_who_dials_a_robot_can_say_with_which_servo_profile_it_runs() -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    flags = {
        name: {flag for option in command.params for flag in option.opts}
        for name, command in commands.items()
    }
    dialing = [name for name, known in flags.items() if "--wait" in known]
    assert "tare" in dialing
    assert [name for name in dialing if "--servo-profile" not in flags[name]] == []
