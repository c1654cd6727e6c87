"""Runs on a cluster equal those of this machine, even if a worker is lost."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

import pytest

from surefoot.errors import EnvironmentFailedError, UsageError
from surefoot.studies import execute
from surefoot.studies.cell import Cell, Group, Row
from surefoot.studies.execute import run_tasks, tasks_of
from tests.command import environment
from tests.support import free_port, wait_until

SHORT = 'name = "short"\nduration_s = {}\n[sensors]\nforce_noise_n = 2.0\n'


@contextmanager
def process(log: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run one of Dask's processes until the context is left."""
    with (
        log.open("wb") as file,
        subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]],
            env=environment(),
            stdout=file,
            stderr=file,
        ) as made,
    ):
        try:
            yield made
        finally:
            made.terminate()


@contextmanager
def begun_scheduler(folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Start a scheduler; return its address and process."""
    port = free_port()
    words = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
    log = folder / "scheduler.log"
    with process(log, "scheduler", *words) as made:
        wait_until(lambda: b"Scheduler at:" in log.read_bytes(), what="the scheduler")
        yield f"tcp://127.0.0.1:{port}", made


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    with begun_scheduler(tmp_path) as (address, _):
        yield address


def worker(
    scheduler: str, folder: Path, name: str
) -> AbstractContextManager[subprocess.Popen[bytes]]:
    words = [scheduler, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    place = ["--local-directory", str(folder / name), "--name", name]
    return process(folder / f"{name}.log", "worker", *words, *place)


def cells(
    folder: Path, seeds: int, *, controller: str = "hold", duration_s: float = 0.2
) -> list[Cell]:
    scenario = folder / "short.toml"
    scenario.write_text(SHORT.format(duration_s))
    group = Group(str(scenario), (), controller, "ideal")
    return [Cell(group, seed) for seed in range(seeds)]


@pytest.mark.process
@pytest.mark.parametrize(
    ("controller", "runs", "duration_s", "kill_after"),
    [
        ("hold", 12, 0.2, 3),
        pytest.param("whole-body", 200, 0.4, 70, marks=pytest.mark.slow),
    ],
)
def test_rows_are_the_local_ones_and_a_killed_worker_costs_nothing(
    tmp_path: Path,
    scheduler: str,
    monkeypatch: pytest.MonkeyPatch,
    controller: str,
    runs: int,
    duration_s: float,
    kill_after: int,
) -> None:
    made = cells(tmp_path, runs, controller=controller, duration_s=duration_s)
    tasks = tasks_of(made, robot="walker", overrides=())
    rows: list[Row] = []
    with ExitStack() as stack:
        first, _ = (
            stack.enter_context(worker(scheduler, tmp_path, name)) for name in "ab"
        )
        for row in run_tasks(tasks, scheduler=scheduler):
            rows.append(row)
            if len(rows) == kill_after:
                first.send_signal(signal.SIGKILL)
                first.wait()
        changed = execute.about_code() | {"code": "0" * 64, "mujoco": "3.0"}
        monkeypatch.setattr(execute, "about_code", lambda: changed)
        with pytest.raises(UsageError) as refused:
            list(run_tasks(tasks, scheduler=scheduler))
    assert sorted(rows, key=lambda row: row["seed"]) == list(run_tasks(tasks, jobs=1))
    assert "worker tcp://127.0.0.1" in str(refused.value)
    assert "instead of 000000000000" in str(refused.value)
    assert "instead of 3.0" in str(refused.value)


@pytest.mark.process
def test_scheduler_without_workers_and_no_scheduler_say_so(
    tmp_path: Path, scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(execute, "_CONNECT_S", 1.0)
    tasks = tasks_of(cells(tmp_path, 1), robot="walker", overrides=())
    with pytest.raises(EnvironmentFailedError, match="dask worker"):
        list(run_tasks(tasks, scheduler=scheduler))
    nobody, locked = f"127.0.0.1:{free_port()}", scheduler.removeprefix("tcp://")
    with socket.create_server(("127.0.0.1", 0)) as silent:
        host, port = silent.getsockname()
        for address in (f"tcp://{nobody}", f"tls://{locked}", f"tcp://{host}:{port}"):
            with pytest.raises(EnvironmentFailedError, match="no Dask scheduler answ"):
                list(run_tasks(tasks, scheduler=address))
    for words in ("tcp://127.0.0.1", "tcp://127.0.0.1:abc", f"ucx://{nobody}"):
        with pytest.raises(UsageError, match="expected the address"):
            list(run_tasks(tasks, scheduler=words))


def test_a_run_that_cannot_begin_is_named(tmp_path: Path) -> None:
    scenario = tmp_path / "step.toml"
    tile = "[[tile]]\ncenter_m = [0.0, 0.11]\nsize_m = [0.4, 0.2]\n"
    scenario.write_text('name = "step"\nduration_s = 0.1\n' + tile)
    values = (("tile.0.height_m", -0.3),)
    cell = Cell(Group(str(scenario), values, "hold", "ideal"), 0)
    tasks = tasks_of([cell], robot="walker", overrides=())
    with pytest.raises(UsageError, match=r"height_m -0\.3\): cannot begin: walk"):
        list(run_tasks(tasks, jobs=1))


@pytest.mark.slow
@pytest.mark.process
def test_a_lost_scheduler_is_one_error_without_tracebacks_of_others(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(execute, "_CONNECT_S", 2.0)
    tasks = tasks_of(cells(tmp_path, 3), robot="walker", overrides=())
    with (
        begun_scheduler(tmp_path) as (address, scheduler),
        worker(address, tmp_path, "a"),
    ):
        rows = run_tasks(tasks, scheduler=address)
        next(rows)
        scheduler.kill()
        with pytest.raises(EnvironmentFailedError, match="the scheduler was lost"):
            list(rows)
    assert "Traceback" not in capfd.readouterr().err + caplog.text
