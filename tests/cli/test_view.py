"""The live page as a process: what it must not disturb, and how it refuses."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
from pathlib import Path

import msgspec
import pytest

from surefoot.schemas.result import RunResult
from tests.command import Surefoot, command, environment
from tests.support import PATIENCE_S, free_port, wait_until

pytest.importorskip("viser", reason="the live page needs viser: pip install -e .[view]")

SCENARIO = """
name = "a while"
duration_s = 2.0
[sensors]
force_noise_n = 2.0
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "while.toml"
    path.write_text(SCENARIO)
    return path


def test_a_port_in_use_is_the_environments_fault(surefoot: Surefoot) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = surefoot("view", "--port", port)
    assert done.returncode == 3
    assert f"127.0.0.1:{port}" in done.stderr
    assert "--port" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_malformed_locator_is_told_at_once(surefoot: Surefoot) -> None:
    done = surefoot("view", "--port", 0, "--connect", "nonsense")
    assert done.returncode == 2
    assert "nonsense" in done.stderr


def test_a_run_in_one_process_has_nothing_to_show(
    surefoot: Surefoot, scenario: Path
) -> None:
    done = surefoot("run", scenario, "--inline", "--view")
    assert done.returncode == 2
    assert "--inline" in done.stderr


def test_a_run_says_that_its_page_cannot_be_served(
    surefoot: Surefoot, scenario: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = surefoot("run", scenario, "--view", "--view-port", port)
    assert done.returncode == 3
    assert f"127.0.0.1:{port}" in done.stderr
    assert "Traceback" not in done.stderr


def test_killing_the_page_changes_nothing(
    surefoot: Surefoot, scenario: Path, tmp_path: Path
) -> None:
    quiet = surefoot("run", scenario, "--json")
    watched = subprocess.Popen(
        command(
            *("run", scenario, "--json", "--view", "--view-port", free_port()),
            *("--out", tmp_path / "run"),
        ),
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    page = wait_until(lambda: _page_with_robot(watched.pid), what="page and robot")
    os.kill(page, signal.SIGKILL)
    out, err = watched.communicate(timeout=PATIENCE_S)
    assert watched.returncode == 0, err.decode()
    assert b"live page: http://127.0.0.1:" in err
    results = [
        msgspec.json.decode(text, type=RunResult) for text in (quiet.stdout, out)
    ]
    assert results[0].log_sha256 == results[1].log_sha256
    assert "process" in (tmp_path / "run" / "view.log").read_text()


def test_ctrl_c_ends_a_page_that_waits_for_a_robot(tmp_path: Path) -> None:
    log = tmp_path / "view.log"
    with log.open("w") as stderr:
        page = subprocess.Popen(
            command("view", "--port", 0, "--connect", f"tcp/127.0.0.1:{free_port()}"),
            env=environment(),
            stderr=stderr,
        )
    wait_until(lambda: "Ctrl-C" in log.read_text(), what="the page")
    page.send_signal(signal.SIGINT)
    assert page.wait(PATIENCE_S) == 130
    assert "Traceback" not in log.read_text()


def _page_with_robot(parent: int) -> int | None:
    """The page's process once the stabilizer has been started, too."""
    children = {
        name: int(pid)
        for pid, words in _children(parent)
        for name in ("view", "stabilizer")
        if name in words
    }
    return children.get("view") if "stabilizer" in children else None


def _children(parent: int) -> list[tuple[str, list[str]]]:
    listed = subprocess.run(
        ["ps", "-A", "-o", "pid=,ppid=,args="],
        capture_output=True,
        text=True,
        check=True,
    )
    rows = [line.split() for line in listed.stdout.splitlines()]
    return [(row[0], row[2:]) for row in rows if row[1] == str(parent)]
