"""Colour and progress on a terminal, and only there."""

from __future__ import annotations

import json
import os
import pty
import re
import subprocess
import sys
from io import StringIO
from itertools import zip_longest
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

import surefoot as sf
from surefoot.cli.summary import counts_table, run_table
from surefoot.recording.write import new_count
from tests.command import environment, scenario_file
from tests.support import PATIENCE_S

COLOUR = re.compile(rb"\x1b\[(?:\d+;)*(?:3[0-8]|9[0-7])m")
RUN = ["--controller", "hold", "--inline"]


def plain(**changes: str) -> dict[str, str]:
    """Return an environment without settings of colours, except the given ones."""
    known = {**environment(), "TERM": "xterm-256color"}
    for name in ("NO_COLOR", "FORCE_COLOR", "COLORTERM"):
        known.pop(name, None)
    return {**known, **changes}


def on_a_terminal(folder: Path, env: dict[str, str], *words: str) -> bytes:
    """Return all that a command shows on a terminal of its own."""
    here, there = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "surefoot.cli", *words],
        cwd=folder,
        env=env,
        stdin=there,
        stdout=there,
        stderr=there,
        close_fds=True,
    ) as process:
        os.close(there)
        shown = b""
        while True:
            try:
                part = os.read(here, 65536)
            except OSError:  # Linux's way to say that the other end is closed
                break
            if not part:
                break
            shown += part
        assert process.wait(PATIENCE_S) == 0, shown
    os.close(here)
    return shown


def test_a_terminal_shows_colour_and_progress(
    tmp_path: Path, short_scenario: Path
) -> None:
    shown = on_a_terminal(tmp_path, plain(), "run", str(short_scenario), *RUN)
    assert COLOUR.search(shown)
    assert b"stood 0.3 s" in shown
    assert b"short" in shown.split(b"stood")[0]  # the bar, before the table


def test_no_color_takes_the_colour_away(tmp_path: Path, short_scenario: Path) -> None:
    env = plain(NO_COLOR="1")
    shown = on_a_terminal(tmp_path, env, "run", str(short_scenario), *RUN)
    assert not COLOUR.search(shown)
    assert b"stood 0.3 s" in shown


@pytest.mark.parametrize(
    "words", [["run", "SHORT", *RUN], ["scenarios"], ["run", "dancing"], ["--help"]]
)
def test_a_pipe_gets_plain_text(
    tmp_path: Path, short_scenario: Path, words: list[str]
) -> None:
    words = [str(short_scenario) if word == "SHORT" else word for word in words]
    done = subprocess.run(
        [sys.executable, "-m", "surefoot.cli", *words],
        cwd=tmp_path,
        env=plain(),
        capture_output=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert b"\x1b" not in done.stdout + done.stderr
    assert b"\r" not in done.stdout + done.stderr


def test_an_encoding_without_umlauts_ends_no_command(tmp_path: Path) -> None:
    scenario = scenario_file(tmp_path, 0.02, name="rüttel")

    def printed(*words: str) -> bytes:
        done = subprocess.run(
            [sys.executable, "-m", "surefoot.cli", "run", str(scenario), *RUN, *words],
            cwd=tmp_path,
            env=plain(PYTHONIOENCODING="ascii"),
            capture_output=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert b"r\\xfcttel, hold" in printed()
    assert json.loads(printed("--json"))["scenario"] == "rüttel"


def test_a_narrow_terminal_cuts_nothing_off_a_table() -> None:
    result = sf.simulate(
        "walker", sf.Scenario(name="short", duration_s=0.02), controller="hold"
    ).result
    place = "/home/me/studies/of/a/platform/that/falls/by/eighty/millimetres/seed-3"
    channel = "a_channel_of_another_program"
    tables = {
        place: run_table(msgspec.structs.replace(result, out=place)),
        channel: counts_table([new_count(channel)]),
    }
    for text, table in tables.items():
        shown = StringIO()
        Console(file=shown, width=50).print(table)
        assert "…" not in shown.getvalue()
        cells = [line.split("│")[1:-1] for line in shown.getvalue().splitlines()]
        columns = [
            "".join(map(str.strip, column))
            for column in zip_longest(*(row for row in cells if row), fillvalue="")
        ]
        assert any(text in column for column in columns)


@pytest.mark.parametrize("columns", ["", "0"])
def test_a_width_of_nothing_is_none(tmp_path: Path, columns: str) -> None:
    shown = on_a_terminal(tmp_path, plain(COLUMNS=columns), "scenarios")
    assert b"moving-platform-fast" in shown


def test_a_closed_pipe_ends_a_command_quietly(tmp_path: Path) -> None:
    """As ``surefoot scenarios | head -1`` does, with a reader that is gone at once."""
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "surefoot.cli", "scenarios"],
        cwd=tmp_path,
        env=plain(),
        stdout=writer,
        stderr=subprocess.PIPE,
        timeout=PATIENCE_S,
        check=False,
    )
    os.close(writer)
    assert b"Traceback" not in done.stderr
    assert b"Broken pipe" not in done.stderr
