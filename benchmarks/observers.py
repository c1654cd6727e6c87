"""Effect of observers on the loop: round trips with and without them.

    python -m benchmarks.observers [--observers 3 | --page] [--rounds 5] [--seconds 10]
                                   [--lockstep] [--controller whole-body]
                                   [--realtime-priority P]

Robot and stabilizer run as two processes in real time. Rounds alternate: alone, and
with observers in processes of their own that take every message of every channel, or
with the live page. Other load of the machine then affects both alike. No browser shows
the page: its drawing would be measured, not the page's part on the bus. Run it on a
quiet machine with a free processor for the observers; else it measures the processors,
not the bus.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
from contextlib import ExitStack
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path

import msgspec
import numpy as np

from benchmarks.started import Started
from surefoot.robot_io.bus.bus import loopback_endpoints
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.result import PlantResult
from surefoot.schemas.topics import TICK_SENSORS

SPAWN = multiprocessing.get_context("spawn")
DEPTH = 256
WAIT_S = 60.0
SCENARIO = """
name = "observed"
duration_s = {seconds}
[sensors]
force_noise_n = 2.0
moment_noise_nm = 0.1
gyro_noise_rad_s = 0.002
accel_noise_m_s2 = 0.05
"""


def look_on(endpoints: Endpoints, tell: Connection) -> None:
    """Take all messages until the robot is gone; report the number of joint states."""
    robot = load_robot("walker")
    joints = 0
    with Observer(robot, endpoints=endpoints, depth=DEPTH) as observer:
        observer.connect(timeout_s=WAIT_S)
        tell.send("ready")
        while observer.robot_is_here:
            samples = observer.take(timeout_s=0.1)
            joints += sum(sample.channel == TICK_SENSORS[0] for sample in samples)
    tell.send(joints)


class Watcher:
    """An observer in a process of its own."""

    def __init__(self, endpoints: Endpoints) -> None:
        """Start it, and wait until it observes."""
        self._come, tell = SPAWN.Pipe(duplex=False)
        self.process: SpawnProcess = SPAWN.Process(
            target=look_on, args=(endpoints, tell)
        )
        self.process.start()
        self.heard()

    def heard(self) -> object:
        """Return its next report.

        Raises:
            TimeoutError: no report came in time.
        """
        if not self._come.poll(WAIT_S):
            self.process.kill()
            raise TimeoutError("an observer says nothing")
        return self._come.recv()


def one_run(
    scenario: Path, how: list[str], controller: str, *, observers: int, page: bool
) -> tuple[PlantResult, list[int]]:
    """Run once; return the robot's result and the number of ticks each observer got."""
    endpoints = loopback_endpoints()
    (locator,) = endpoints.listen
    folder = scenario.parent
    result = folder / "plant.json"
    words = ("robot", scenario, "--listen", locator, "--result-file", result, *how)
    dial = ("stabilizer", "--connect", locator, "--controller", controller, *how)
    view = ("view", "--port", 0, "--connect", locator)
    with Started(folder / "robot.log", *words) as plant, ExitStack() as stack:
        plant.wait_for("waits for a stabilizer")
        if page:
            shown = stack.enter_context(Started(folder / "view.log", *view))
            shown.wait_for("Ctrl-C ends the page")
        watchers = [Watcher(endpoints) for _ in range(observers)]
        with Started(folder / "stabilizer.log", *dial) as stabilizer:
            plant.exit_code()
            stabilizer.exit_code()
        heard = [int(str(watcher.heard())) for watcher in watchers]
        for watcher in watchers:
            watcher.process.join()
    return msgspec.json.decode(result.read_bytes(), type=PlantResult), heard


def line(name: str, result: PlantResult, heard: list[int]) -> str:
    """Return a run on one line."""
    trip = result.round_trip_ms
    got = ", ".join(f"{100.0 * count / result.ticks:.1f} %" for count in heard)
    return (
        f"{name:<16} round trip median {trip.median:.3f}, p99 {trip.p99:.3f}, max "
        f"{trip.max:.3f} ms; period jitter p99 {result.period_jitter_ms.p99:.3f} ms; "
        f"{result.deadline_misses} of {result.ticks} ticks without their command"
        + (f"; observers got {got}" if heard else "")
    )


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--observers", type=int, default=3)
    parser.add_argument("--page", action="store_true", help="the live page instead")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--lockstep", action="store_true")
    parser.add_argument("--controller", default="whole-body")
    parser.add_argument("--realtime-priority", help="of robot and stabilizer")
    arguments = parser.parse_args()
    pace = "--lockstep" if arguments.lockstep else "--realtime"
    how = [pace]
    if arguments.realtime_priority is not None:
        how += ["--realtime-priority", arguments.realtime_priority]
    onlookers = "live page" if arguments.page else f"{arguments.observers} observers"
    found: dict[str, list[PlantResult]] = {"alone": [], onlookers: []}
    with tempfile.TemporaryDirectory() as name:
        scenario = Path(name) / "observed.toml"
        scenario.write_text(SCENARIO.format(seconds=arguments.seconds))
        for _ in range(arguments.rounds):
            for who, results in found.items():
                looks_on = who == onlookers
                result, heard = one_run(
                    scenario,
                    how,
                    arguments.controller,
                    observers=arguments.observers * (looks_on and not arguments.page),
                    page=looks_on and arguments.page,
                )
                results.append(result)
                print(line(who, result, heard), flush=True)
    print(f"\nmedian over {arguments.rounds} rounds, {pace[2:]}")
    for who, results in found.items():
        medians = np.median([r.round_trip_ms.median for r in results])
        tails = np.median([r.round_trip_ms.p99 for r in results])
        applied = np.median([r.end_to_end_ms.p99 for r in results])
        print(
            f"{who}: round trip median {medians:.3f}, p99 {tails:.3f} ms; "
            f"sensors to servos p99 {applied:.3f} ms"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
