"""Robot and stabilizer as real processes, for tests."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.scenario import scenario_from_table
from surefoot.sim_robot.robot_loop import RobotRun, run_robot
from surefoot.stabilizer.control.controller import HoldController
from surefoot.stabilizer.control.whole_body import WholeBodyController
from surefoot.stabilizer.node import run_stabilizer
from tests.patient_robot import patient
from tests.support import PATIENCE_S

FORKED = multiprocessing.get_context("forkserver")
FORKED.set_forkserver_preload(
    [
        "surefoot.robot_io.client_side.observer",
        "surefoot.sim_robot.robot_loop",
        "surefoot.stabilizer.control.whole_body",
        "surefoot.stabilizer.node",
        "surefoot.stabilizer.zmp.controller",
    ]
)
"""Processes of a server that has loaded everything and opened nothing: loading is most
of what a short process costs."""
SEED = 3


class ProcessError(Exception):
    """What a process raised: name of the error's class, and its message."""


class Running:
    """A process that sends back what it returned or raised."""

    def __init__(self, target: Any, *args: Any) -> None:
        self._results, sender = FORKED.Pipe(duplex=False)
        self.process = FORKED.Process(target=_report, args=(sender, target, *args))
        self.process.start()
        sender.close()

    def result(self) -> Any:
        """What it returned; fails when it did not in time, or ended without a word."""
        assert self._results.poll(2 * PATIENCE_S), "the process did not end"
        kind, value = self._results.recv()
        self.process.join(PATIENCE_S)
        if kind == "error":
            raise ProcessError(value)
        return value

    def signal(self, number: int) -> None:
        self.process._popen._send_signal(number)

    def kill(self) -> None:
        """End it without a chance to say goodbye."""
        self.process.kill()
        self.process.join(PATIENCE_S)

    def exit_code(self) -> int | None:
        self.process.join(PATIENCE_S)
        return self.process.exitcode


@contextmanager
def running(target: Any, *args: Any) -> Iterator[Running]:
    """Start a process and make sure that it is gone afterwards."""
    started = Running(target, *args)
    try:
        yield started
    finally:
        if started.process.is_alive():
            started.kill()


def robot(endpoints: Endpoints, table: dict[str, Any], pace: Pace) -> RobotRun:
    """The simulated Walker in a scenario; in real time a patient one."""
    scenario = scenario_from_table({"name": "test", **table}, source="test")
    walker = load_robot("walker")
    return run_robot(
        patient(walker) if pace is Pace.REALTIME else walker,
        scenario,
        seed=SEED,
        endpoints=endpoints,
        pace=pace,
        wait_s=PATIENCE_S,
    )


def stabilizer(endpoints: Endpoints, pace: Pace, identity: str = "ann") -> Any:
    """A controller that keeps the posture."""
    walker = load_robot("walker")
    return run_stabilizer(
        lambda settings: HoldController(walker.n_a),
        walker,
        endpoints=endpoints,
        pace=pace,
        identity=identity,
        connect_timeout_s=PATIENCE_S,
    )


def balancing(endpoints: Endpoints) -> Any:
    """The whole-body controller, in lockstep."""
    walker = load_robot("walker")
    return run_stabilizer(
        lambda settings: WholeBodyController(walker, settings),
        walker,
        endpoints=endpoints,
        pace=Pace.LOCKSTEP,
        identity="ann",
        connect_timeout_s=PATIENCE_S,
    )


def _report(results: Connection, target: Any, *args: Any) -> None:
    try:
        results.send(("result", target(*args)))
    except Exception as error:
        results.send(("error", f"{type(error).__name__}: {error}"))
