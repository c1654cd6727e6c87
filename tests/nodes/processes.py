"""Robot and stabilizer as real processes."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from surefoot.robot_io.client_side.observer import (
    VIEWER_CHANNELS,
    LatestMessages,
    Observer,
)
from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.ticks.write import TickFile
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.result import PlantResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.sim_robot.robot_loop import run_robot
from surefoot.stabilizer.controller import HoldController
from surefoot.stabilizer.node import run_stabilizer
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.patient_robot import gentle_settings, patient
from tests.support import PATIENCE_S, wait_until

FORKED = multiprocessing.get_context("forkserver")
FORKED.set_forkserver_preload(
    [
        "surefoot.robot_io.client_side.observer",
        "surefoot.sim_robot.robot_loop",
        "surefoot.stabilizer.whole_body.controller",
        "surefoot.stabilizer.node",
        "surefoot.stabilizer.zmp.controller",
    ]
)
"""A server that has loaded everything forks the processes, which saves time."""
SEED = 3
NOISE = {"force_noise_n": 2.0, "gyro_noise_rad_s": 0.002, "accel_noise_m_s2": 0.05}


class ProcessError(Exception):
    """Exception of a process: name of its class, and its message."""


class Running:
    """A process that sends back its result or exception."""

    def __init__(self, target: Any, *args: Any) -> None:
        self._results, sender = FORKED.Pipe(duplex=False)
        self.process = FORKED.Process(target=_report, args=(sender, target, *args))
        self.process.start()
        sender.close()

    def result(self) -> Any:
        """Return the result; fails if it is late or the process ended without one."""
        assert self._results.poll(2 * PATIENCE_S), "the process did not end"
        kind, value = self._results.recv()
        self.process.join(PATIENCE_S)
        if kind == "error":
            raise ProcessError(value)
        return value

    def signal(self, number: int) -> None:
        self.process._popen._send_signal(number)

    def kill(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.join(PATIENCE_S)

    def exit_code(self) -> int | None:
        self.process.join(PATIENCE_S)
        return self.process.exitcode


@contextmanager
def running(target: Any, *args: Any) -> Iterator[Running]:
    """Start a process, and make sure that it is gone afterwards."""
    started = Running(target, *args)
    try:
        yield started
    finally:
        if started.process.is_alive():
            started.kill()


class Silence:
    """A commander's silence, which lasts until the test has seen its consequences.

    No clock ends it, since the time of a robot on a busy machine is slow.
    """

    def __init__(self) -> None:
        self._test, self._commander = FORKED.Pipe()
        self._is_over = False

    def keep(self, tick: int) -> bool:
        """Leave a tick unanswered until the test ends the silence.

        Called in the commander's process.

        Returns:
            Whether there was a silence; only once.
        """
        if self._is_over:
            return False
        self._commander.send(tick)
        assert self._commander.poll(PATIENCE_S), "nobody ended the silence"
        self._commander.recv()
        self._is_over = True
        return True

    def begun(self) -> int:
        """Return the tick at which the silence began, once it has."""
        assert self._test.poll(PATIENCE_S), "the commander did not fall silent"
        tick: int = self._test.recv()
        return tick

    def end(self) -> None:
        self._test.send(None)


def robot(
    endpoints: Endpoints, table: dict[str, Any], pace: Pace, **gate: float
) -> PlantResult:
    """Run the simulated Walker in a scenario; in real time one that waits long.

    Args:
        endpoints: where it listens.
        table: the scenario without its name.
        pace: lockstep or real time.
        gate: values of the waiting robot's gate to change.
    """
    scenario = scenario_from_table({"name": "test", **table}, source="test")
    walker = load_robot("walker")
    return run_robot(
        patient(walker, **gate) if pace is Pace.REALTIME else walker,
        scenario,
        seed=SEED,
        endpoints=endpoints,
        pace=pace,
        wait_s=PATIENCE_S,
    )


def recorded_robot(
    endpoints: Endpoints, table: dict[str, Any], record: Path
) -> PlantResult:
    """Run the Walker in lockstep and record its ticks to a file."""
    with TickFile(record, may_wait=True) as ticks:
        return run_robot(
            load_robot("walker"),
            scenario_from_table({"name": "test", **table}, source="test"),
            seed=SEED,
            endpoints=endpoints,
            pace=Pace.LOCKSTEP,
            ticks=ticks,
            wait_s=PATIENCE_S,
        )


def stabilizer(endpoints: Endpoints, pace: Pace, identity: str = "ann") -> Any:
    """Run a controller that keeps the posture."""
    walker = load_robot("walker")
    return run_stabilizer(
        lambda settings: HoldController(walker.n_a),
        walker,
        endpoints=endpoints,
        pace=pace,
        identity=identity,
        connect_timeout_s=PATIENCE_S,
    )


def balancing(endpoints: Endpoints, identity: str = "ann") -> Any:
    """Run the whole-body controller in lockstep."""
    walker = load_robot("walker")
    return run_stabilizer(
        lambda settings: WholeBodyController(walker, settings),
        walker,
        endpoints=endpoints,
        pace=Pace.LOCKSTEP,
        identity=identity,
        connect_timeout_s=PATIENCE_S,
    )


def balance(
    endpoints: Endpoints,
    pace: Pace,
    identity: str = "ann",
    path: str = "walker",
    walk: WalkPlan | None = None,
) -> Any:
    """Run the whole-body controller with gentle settings that can be changed."""
    walker = load_robot(path)
    return run_stabilizer(
        lambda settings: WholeBodyController(walker, settings),
        walker,
        endpoints=endpoints,
        pace=pace,
        identity=identity,
        connect_timeout_s=PATIENCE_S,
        settings=gentle_settings(),
        walk=walk,
    )


class Onlooker:
    """An observer that waits until it has seen something."""

    def __init__(self, observer: Observer) -> None:
        self.observer = observer

    def until(
        self, condition: Callable[[LatestMessages], object], *, what: str
    ) -> LatestMessages:
        """Return the first status, stabilizer and joints that fulfil a condition."""

        def look() -> LatestMessages | None:
            sight = self.observer.latest_messages()
            is_whole = sight.status and sight.stabilizer and sight.joints
            return sight if is_whole and condition(sight) else None

        seen = wait_until(look, what=what)
        assert seen is not None
        return seen

    def tick(self) -> int:
        joints = self.until(lambda sight: True, what="any message").joints
        assert joints is not None
        return joints.tick

    def let_go_on(self, ticks: int) -> LatestMessages:
        """Return what is seen of the run a number of ticks later."""
        later = self.tick() + ticks
        return self.until(
            lambda sight: sight.joints and sight.joints.tick > later,
            what="the run to go on",
        )


@contextmanager
def looking(endpoints: Endpoints, path: str = "walker") -> Iterator[Observer]:
    """Observe the bus under the name eve, as the live page does."""
    robot = load_robot(path)
    with Observer(
        robot, endpoints=endpoints, channels=VIEWER_CHANNELS, identity="eve"
    ) as observer:
        observer.connect(timeout_s=PATIENCE_S)
        yield observer


def _report(results: Connection, target: Any, *args: Any) -> None:
    try:
        results.send(("result", target(*args)))
    except Exception as error:
        results.send(("error", f"{type(error).__name__}: {error}"))
