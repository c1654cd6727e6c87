"""The loop of a driver with faulty hardware, and the example as a user runs it."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot_side.driver import drive
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import ModeCause
from tests.command import REPOSITORY, Surefoot, environment, run_python
from tests.patient_robot import JUDGED, patient_robot_file
from tests.robot_io.client_at_work import WALKER, new_client, status_when
from tests.robot_io.conformance.verdict import check_passes_but_for_time
from tests.robot_io.sensor_messages import snapshot_at
from tests.support import PATIENCE_S, wait_until

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
    ],
)
def test_what_is_no_posture_at_first_is_refused_and_nothing_moves(
    endpoints: Endpoints, q: np.ndarray, told: str
) -> None:
    hardware, stop = Hardware(q), StopRequest()
    stop.set()
    with pytest.raises(RobotFileError, match=told):
        drive(hardware, WALKER, endpoints=endpoints, stop=stop)
    assert hardware.written == []


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"q": WALKER.nominal[1:]}, "q: got an array (27,) of float64, expected an"),
        ({"q": WALKER.nominal.tolist()}, "q: got [0.0, "),
        ({"dq": None}, "dq: got None, expected an array (28,) of floats"),
        ({"quat_xyzw": np.eye(4)}, "quat_xyzw: got an array (4, 4) of float64"),
        ({"ft_left": np.array(["1"] * 6)}, "ft_left: got an array (6,) of <U1"),
    ],
)
def test_a_first_reading_of_another_shape_is_refused(
    endpoints: Endpoints, changed: dict[str, Any], told: str
) -> None:
    class Misread(Hardware):
        def read(self, tick: int, stamp_ns: int) -> Snapshot:
            return replace(super().read(tick, stamp_ns), **changed)

    hardware, stop = Misread(WALKER.nominal), StopRequest()
    stop.set()
    with pytest.raises(RobotFileError, match=re.escape(told)):
        drive(hardware, WALKER, endpoints=endpoints, stop=stop)
    assert hardware.written == []


@contextmanager
def driven(hardware: Hardware, endpoints: Endpoints) -> Iterator[None]:
    """A driver's loop in a thread."""
    up, stop = threading.Event(), StopRequest()
    thread = threading.Thread(
        target=drive,
        args=(hardware, WALKER),
        kwargs={"endpoints": endpoints, "ready": up.set, "stop": stop},
    )
    thread.start()
    try:
        assert up.wait(PATIENCE_S)
        yield
    finally:
        stop.set()
        thread.join()


def test_a_driver_in_the_pace_of_the_loop_may_miss_a_sensor(
    endpoints: Endpoints,
) -> None:
    class Deaf(Hardware):
        missing = ("imu",)

    with (
        driven(Deaf(WALKER.nominal), endpoints),
        new_client(endpoints, "ann") as client,
    ):
        assert client.connect(timeout_s=PATIENCE_S)

        def lacks_the_imu() -> bool:
            whole = client.wait_snapshot(timeout_s=0.05)
            return whole is None and client.missing_sensors() == ("imu",)

        wait_until(lacks_the_imu, what="ticks without the IMU")


def test_a_driver_with_its_own_pace_need_not_tell_what_is_missing(
    endpoints: Endpoints,
) -> None:
    class Paced(Hardware):
        waits = 0

        def read(self, tick: int, stamp_ns: int) -> Snapshot:
            if tick == 9:
                stop.set()
            return super().read(tick, stamp_ns)

        def wait(self) -> None:
            self.waits += 1
            if self.waits == 3:
                stop.set()

    hardware, stop = Paced(WALKER.nominal), StopRequest()
    drive(hardware, "walker", endpoints, stop=stop)
    assert (hardware.waits, len(hardware.written)) == (3, 3)


def test_hardware_that_fails_is_held_and_its_commander_told_why(
    endpoints: Endpoints,
) -> None:
    hardware, ended = Hardware(WALKER.nominal), Future[str]()
    up = threading.Event()

    def serve() -> None:
        try:
            ended.set_result(drive(hardware, WALKER, endpoints=endpoints, ready=up.set))
        except Exception as error:
            ended.set_exception(error)

    thread = threading.Thread(target=serve)
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
