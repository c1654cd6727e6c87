"""The commands on all pages have existing names and options."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, cast

import pytest
from typer.main import get_command

from surefoot.cli.app import app
from surefoot.run_plan import resolve_settings
from surefoot.sim_robot.catalogue import find_scenario
from surefoot.stabilizer.factory import find_controller

ROOT = Path(__file__).parents[2]
PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for pattern in ("README.md", "CONTRIBUTING.md", "docs/*.md", "*/README.md")
    for path in ROOT.glob(pattern)
}
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
PROGRAM: Any = get_command(app)
LEAST = 80
"""Least number of commands, so that a changed form of a page is noticed."""


def shown(text: str) -> Iterator[list[str]]:
    """Yield the words of each command on a page, after ``surefoot``."""
    for kind, block in BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            if not line.startswith("$ ") and kind != "sh":
                continue
            words = shlex.shlex(
                line.removeprefix("$ "), posix=True, punctuation_chars=True
            )
            words.whitespace_split = True
            for ends, part in groupby(words, lambda word: set(word) <= set(";|&<>")):
                program, *rest = part
                if not ends and program == "surefoot":
                    yield rest


COMMANDS = {name: [*shown(path.read_text("utf-8"))] for name, path in PAGES.items()}


def given(words: list[str]) -> dict[str, Any]:
    """Return the values that a command's arguments and options are given.

    Raises:
        KeyError: there is no such command.
        UsageError: of click: there is no such option or choice.
    """
    command = PROGRAM
    while hasattr(command, "commands"):
        name, *words = words
        command = command.commands[name]
    return cast(dict[str, Any], command.make_context(name, words).params)


def is_of_the_reader(file: str | None) -> bool:
    return str(file).endswith(".toml")


@pytest.mark.parametrize("page", [page for page, words in COMMANDS.items() if words])
def test_names_and_options_exist(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for words in COMMANDS[page]:
        options = given(words)
        settings = options.get("settings")
        if not is_of_the_reader(settings):
            resolve_settings(settings, overrides=options.get("overrides") or ())
        if isinstance(law := options.get("controller"), str):
            find_controller(law)
        scenarios = options.get("scenarios") or [options.get("scenario")]
        for scenario in scenarios:
            if scenario and not is_of_the_reader(scenario):
                find_scenario(scenario)


def test_there_are_commands_to_look_at() -> None:
    assert sum(map(len, COMMANDS.values())) > LEAST
