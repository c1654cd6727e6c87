"""The live page as a process: it disturbs nothing, and refuses wrong options."""

from __future__ import annotations

import signal
import socket
import subprocess
from pathlib import Path

import pytest

from tests.command import Surefoot, command, environment
from tests.support import PATIENCE_S, free_port, wait_until

pytest.importorskip("viser", reason="the live page needs viser: pip install -e .[view]")


def test_a_port_in_use_is_the_environments_fault(surefoot_here: Surefoot) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = surefoot_here("view", "--port", port)
    assert done.returncode == 3
    assert f"127.0.0.1:{port}" in done.stderr
    assert "--port" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_malformed_locator_is_told_at_once(surefoot_here: Surefoot) -> None:
    done = surefoot_here("view", "--port", 0, "--connect", "nonsense")
    assert done.returncode == 2
    assert "nonsense" in done.stderr


def test_a_run_in_one_process_has_nothing_to_show(
    surefoot: Surefoot, short_scenario: Path
) -> None:
    done = surefoot("run", short_scenario, "--inline", "--view")
    assert done.returncode == 2
    assert "--inline" in done.stderr


def test_a_run_says_that_its_page_cannot_be_served(
    surefoot: Surefoot, short_scenario: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = surefoot("run", short_scenario, "--view", "--view-port", port)
    assert done.returncode == 3
    assert f"127.0.0.1:{port}" in done.stderr
    assert "Traceback" not in done.stderr


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
