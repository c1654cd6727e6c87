"""Ctrl-C ends every command that waits or works, at once and in order."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.identity import new_identity
from surefoot.robot_io.robot import load_robot
from surefoot.runs import load_run
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.topics import ALIVE_OBSERVER
from tests.command import command, environment, scenario_file
from tests.support import PATIENCE_S, free_port, wait_until

ENDLESS_S = "36000"
A_BLOCK_BYTES = 500_000
"""Bytes: more than a record's head, less than its first block of ticks."""
LISTENING = {
    "echo": ["echo", "joints"],
    "hz": ["hz", "--for", ENDLESS_S],
}
DIALING = {
    "topics": ["topics", "--for", ENDLESS_S],
    "stabilizer": ["stabilizer", "--controller", "hold"],
    "check-robot": ["check-robot"],
}
WORKING = {
    "run": ["run", "hour.toml", "--controller", "hold", "--inline", "--out", "out"],
    "sweep": ["sweep", "hour.toml", "--controllers", "hold", "--out", "out",
              "--jobs", "2"],
    "reproduce": ["reproduce", "--quick", "--out", "out", "--jobs", "2"],
}  # fmt: skip


@contextmanager
def started(folder: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Start a command in a process group of its own, as a shell does."""
    scenario_file(folder, 3600.0, name="hour")
    with subprocess.Popen(
        command(*words),
        cwd=folder,
        env=environment(),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def ends_clean(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Send SIGINT to the whole group; return the command's output."""
    os.killpg(process.pid, signal.SIGINT)
    stdout, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130, stderr
    for word in ("Traceback", "Error", "Aborted", "Warning"):
        assert word not in stderr
    return stdout, stderr


# Each command once, dialing or listening: both take the same way.
@pytest.mark.parametrize("name", DIALING)
def test_while_it_dials(tmp_path: Path, name: str) -> None:
    """Somebody answers the call there, and then says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_S)
        locator = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        words = [*DIALING[name], "--connect", locator, "--wait", ENDLESS_S]
        with started(tmp_path, *words) as process:
            connection, _ = server.accept()
            with connection:
                stdout, _ = ends_clean(process)
    if name != "stabilizer":  # which tells what it has done, even if that is nothing
        assert stdout == ""


# A recorder's: test_record.py.
@pytest.mark.parametrize("name", LISTENING)
def test_while_it_listens(tmp_path: Path, endpoints: Endpoints, name: str) -> None:
    seen: list[str] = []
    with Bus(endpoints, Role.ROBOT, namespace="walker") as bus:
        bus.watch_presence(
            f"{ALIVE_OBSERVER}/*", lambda key, is_there: seen.append(key)
        )
        bus.announce(new_identity(load_robot("walker")).token)
        words = [*LISTENING[name], "--connect", endpoints.connect[0]]
        with started(tmp_path, *words, "--wait", ENDLESS_S) as process:
            wait_until(lambda: seen, what="the listener")
            ends_clean(process)


@pytest.mark.usual("run", "sweep")
@pytest.mark.parametrize("name", WORKING)
def test_while_it_works(tmp_path: Path, name: str) -> None:
    with started(tmp_path, *WORKING[name]) as process:
        wait_until(
            lambda: [
                *tmp_path.glob("out/runs.jsonl"),
                *(
                    file
                    for file in tmp_path.glob("out/ticks.mcap")
                    if file.stat().st_size > A_BLOCK_BYTES
                ),
            ],
            what="the work to begin",
        )
        stdout, _ = ends_clean(process)
    if name == "run":
        assert "interrupted" in stdout
        kept = load_run(tmp_path / "out")
        assert kept.outcome is Outcome.INTERRUPTED
        assert kept.signals.count == kept.result.ticks
        assert not [*tmp_path.glob("out/*.partial")]
    else:
        assert stdout == ""


def test_while_the_router_serves(tmp_path: Path) -> None:
    port = free_port()

    def is_open() -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", port)) == 0

    with started(tmp_path, "router", "--listen", f"tcp/127.0.0.1:{port}") as process:
        wait_until(is_open, what="the router")
        ends_clean(process)


def test_while_the_doctor_examines(tmp_path: Path) -> None:
    with started(tmp_path, "doctor") as process:
        assert process.stdout is not None
        assert "Python" in process.stdout.readline()
        ends_clean(process)


def test_a_killed_sweep_takes_its_workers_along(tmp_path: Path) -> None:
    def workers(parent: int) -> list[int]:
        """Return the processes of the group except the first."""
        found = []
        for entry in Path("/proc").glob("[0-9]*/stat"):
            try:
                state, _, group = entry.read_text().rpartition(") ")[2].split()[:3]
            except OSError:
                continue  # gone meanwhile
            if int(group) == parent != int(entry.parent.name) and state != "Z":
                found.append(int(entry.parent.name))
        return found

    if not Path("/proc/self/stat").exists():
        pytest.skip("no /proc here to look for processes in")
    with started(tmp_path, *WORKING["sweep"]) as process:
        log = tmp_path / "out" / "runs.jsonl"
        wait_until(log.exists, what="the sweep to begin")
        wait_until(
            lambda: len(workers(process.pid)) >= 2,
            what="two workers",
        )
        process.kill()
        wait_until(
            lambda: not workers(process.pid),
            what="the workers to end",
        )
