"""The loop of a driver with faulty hardware, and the example as a user runs it."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot_side.driver import run_driver
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import ModeCause
from tests.command import REPOSITORY, Surefoot, environment, run_python
from tests.patient_robot import JUDGED, patient_robot_file
from tests.robot_io.client_at_work import WALKER, new_client, status_when
from tests.robot_io.conformance.verdict import check_passes_but_for_time
from tests.robot_io.sensor_messages import snapshot_at
from tests.support import PATIENCE_S

DRIVER = REPOSITORY / "deploy" / "driver" / "acme_driver.py"
MOST_LINES = 100


class Hardware:
    """A robot at rest.

    Attributes:
        q: joint positions that it reads [rad].
        cable_is_cut: whether the next reading fails.
        written: all postures that it was commanded.
    """

    def __init__(self, q: np.ndarray) -> None:
        self.q = q
        self.cable_is_cut = False
        self.written: list[np.ndarray] = []

    def read(self, tick: int, stamp_ns: int) -> Snapshot:
        if self.cable_is_cut:
            raise OSError("the cable is cut")
        return replace(snapshot_at(tick), stamp_ns=stamp_ns, q=self.q)

    def write(self, q_command: np.ndarray) -> None:
        self.written.append(q_command)


@pytest.mark.parametrize(
    ("q", "told"),
    [
        (np.degrees(WALKER.nominal), "are they in rad"),
        (WALKER.nominal[::-1], "in the order of the robot file"),
        (np.full(WALKER.n_a, np.nan), "reads nan rad for head_yaw"),
        (WALKER.nominal[1:], "reads 27 joint positions, expected 28"),
    ],
)
def test_what_is_no_posture_at_first_is_refused_and_nothing_moves(
    endpoints: Endpoints, q: np.ndarray, told: str
) -> None:
    hardware, stop = Hardware(q), StopRequest()
    stop.set()
    with pytest.raises(RobotFileError, match=told):
        run_driver(hardware, WALKER, endpoints=endpoints, stop=stop)
    assert hardware.written == []


def test_hardware_that_fails_is_held_and_its_commander_told_why(
    endpoints: Endpoints,
) -> None:
    hardware, ended = Hardware(WALKER.nominal), Future[str]()
    up = threading.Event()

    def drive() -> None:
        try:
            ended.set_result(
                run_driver(hardware, WALKER, endpoints=endpoints, ready=up.set)
            )
        except Exception as error:
            ended.set_exception(error)

    thread = threading.Thread(target=drive)
    thread.start()
    assert up.wait(PATIENCE_S)
    with new_client(endpoints, "ann") as client:
        assert client.connect(timeout_s=PATIENCE_S)
        client.take_lease()
        hardware.cable_is_cut = True
        status = status_when(
            client, lambda status: status.mode is RobotMode.OFF, what="the end"
        )
    thread.join()
    assert status.cause is ModeCause.STOPPED
    assert "the cable is cut" in status.detail
    np.testing.assert_array_equal(hardware.written[-1], WALKER.nominal)
    with pytest.raises(OSError, match="the cable is cut"):
        ended.result()


@pytest.mark.process
def test_the_example_driver_passes(
    surefoot_here: Surefoot, endpoint_file: Path, tmp_path: Path
) -> None:
    robot = patient_robot_file(tmp_path, **JUDGED)
    words = [sys.executable, DRIVER, endpoint_file, robot]
    driver = subprocess.Popen(words, env=environment())
    try:
        words = ["--endpoints", endpoint_file, "--robot", robot, "--wait", PATIENCE_S]
        done = surefoot_here("check-robot", *words, "--json")
        check_passes_but_for_time(done)
        driver.send_signal(signal.SIGTERM)
        assert driver.wait(PATIENCE_S) == 0
    finally:
        driver.kill()
        driver.wait()


def test_the_example_is_short() -> None:
    assert len(DRIVER.read_text().splitlines()) < MOST_LINES


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        ([], 2, "usage: acme_driver.py"),
        (["nowhere.toml"], 2, "nowhere.toml: no such file"),
        ([REPOSITORY / "deploy" / "loopback.toml", "warker"], 2, "'walker'"),
    ],
)
def test_the_example_tells_mistakes_in_one_line(
    tmp_path: Path, words: list[object], code: int, told: str
) -> None:
    done = run_python(DRIVER, *words, cwd=tmp_path)
    assert done.returncode == code
    assert told in done.stderr
    assert len(done.stderr.splitlines()) == 1
