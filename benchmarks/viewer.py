"""What the live page costs the loop: round trips with and without it in one run.

    python -m benchmarks.viewer [SCENARIO] [--rounds 5] [--window 10] [--lockstep]
        [--realtime-priority P]

Runs the robot in this process and the stabilizer in another, in real time unless asked
otherwise, starts and ends ``surefoot view`` in turn, and prints the round trips of each
window: from sensors sent to command taken in. What happens while the page comes or goes
is left out. No browser is open: its drawing would be measured, not the page's part on
the bus.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np

from surefoot.cli.options import claim_processor
from surefoot.robot_io.bus.bus import loopback_endpoints
from surefoot.robot_io.realtime import Pace, StopRequest, quiet_interpreter
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.result import Distribution
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.sim_robot.robot_loop import RobotLoop
from surefoot.sim_robot.simulated_robot import SimulatedRobot

OFF, ON = "without", "with"
SETTLE_S = 2.0
"""Left out after the page has come or gone."""
START_S = 60.0
"""Time allowed for processes to start [s]."""
LONGEST_S = 3600.0
MEASURED = "measured"
"""Who asks the robot to stop once all is measured."""
MS_PER_NS = 1e-6


class RoundTrips:
    """Durations, kept by what was going on when they were taken.

    Takes the place of the loop's own log of them.

    Attributes:
        phase: where they go; None to leave them out.
    """

    def __init__(self) -> None:
        """Start with no durations."""
        self.phase: list[int] | None = None

    def add(self, duration_ns: int) -> None:
        """Keep a duration [ns]."""
        if self.phase is not None:
            self.phase.append(duration_ns)


def distribution(durations_ns: list[int]) -> Distribution:
    """Summarise a window [ms].

    Raises:
        RuntimeError: nothing was measured.
    """
    if not durations_ns:
        raise RuntimeError("no round trip in a window; did the robot stop?")
    median, p99 = MS_PER_NS * np.percentile(durations_ns, (50.0, 99.0))
    return Distribution(
        median=float(median), p99=float(p99), max=MS_PER_NS * max(durations_ns)
    )


def child(*words: str, log: Path) -> subprocess.Popen[bytes]:
    """Start a ``surefoot`` command as a process that logs to a file."""
    with log.open("wb") as stderr:
        return subprocess.Popen(
            [sys.executable, "-m", "surefoot.cli", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=stderr,
        )


def alternate(
    trips: RoundTrips,
    endpoints: Endpoints,
    *,
    rounds: int,
    window_s: float,
    stop: StopRequest,
) -> None:
    """Open and close the page, and print each window as it ends."""
    pause = threading.Event()
    p99: dict[str, list[float]] = {OFF: [], ON: []}
    if hasattr(os, "SCHED_OTHER"):  # of this thread, and so of the page
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))

    def measure(name: str) -> None:
        pause.wait(SETTLE_S)
        trips.phase = window = []
        pause.wait(window_s)
        trips.phase = None
        found = distribution(window)
        p99[name].append(found.p99)
        print(
            f"{name:>8}{len(window):>8}{found.median:>10.3f}{found.p99:>10.3f}"
            f"{found.max:>10.3f}",
            flush=True,
        )

    print(f"{'page':>8}{'trips':>8}{'median':>10}{'p99':>10}{'max':>10}  [ms]")
    try:
        for _ in range(rounds):
            measure(OFF)
            page = child(
                *("view", "--port", "0", "--child"),
                *("--connect", endpoints.connect[0]),
                log=Path(os.devnull),
            )
            try:
                assert page.stdout is not None
                if not page.stdout.readline().startswith(b"http"):
                    raise RuntimeError("the page did not come up: surefoot view")
                measure(ON)
            finally:
                page.terminate()
                page.wait()
        ratios = [on / off for off, on in zip(p99[OFF], p99[ON], strict=True)]
        print(
            f"p99, median over the windows: {statistics.median(p99[OFF]):.3f} ms "
            f"without, {statistics.median(p99[ON]):.3f} ms with; ratio of neighbours "
            f"{statistics.median(ratios):.2f} (from {min(ratios):.2f} to "
            f"{max(ratios):.2f})"
        )
    finally:
        stop.set(MEASURED)


def run(
    scenario: str,
    *,
    pace: Pace,
    priority: int | None,
    measure: Callable[[RoundTrips, Endpoints, StopRequest], None],
) -> bool:
    """Run the robot here, its stabilizer beside it, and measure meanwhile.

    Returns:
        Whether all was measured.
    """
    claim = () if priority is None else ("--realtime-priority", str(priority))
    claim_processor(cpu=None, priority=priority)
    robot, endpoints, stop = load_robot("walker"), loopback_endpoints(), StopRequest()
    world = msgspec.structs.replace(load_scenario(scenario), duration_s=LONGEST_S)
    simulated = SimulatedRobot(robot, world, seed=0)
    gate = CommandGate(robot, simulated.held_posture)
    trips = RoundTrips()
    stabilizer = child(
        *("stabilizer", f"--{pace}", "--wait", str(START_S), "--json", *claim),
        *("--connect", endpoints.connect[0]),
        log=Path(os.devnull),
    )
    with (
        ThreadPoolExecutor() as workers,
        stop.on_signals(),
        RobotServer(robot, gate, endpoints=endpoints, stop=stop, pace=pace) as server,
    ):
        loop = RobotLoop(
            simulated, gate, server, pace=pace, period_s=robot.period_s, ticks=1
        )
        loop.round_trip = trips  # type: ignore[assignment]  # adds as the log does
        if not server.wait_until_active(now_s=0.0, timeout_s=START_S):
            return False
        meter = workers.submit(measure, trips, endpoints, stop)
        with quiet_interpreter():
            loop.run(stop)
        stop.set()
        gate.modes.finish(*simulated.own_end)
        server.publish_status(now_s=simulated.time_s, at_once=True)
        meter.result()  # raises what went wrong there
    stabilizer.communicate(timeout=START_S)
    return stop.cause == MEASURED


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="standing")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--window", type=float, default=10.0, help="seconds")
    parser.add_argument("--lockstep", action="store_true")
    parser.add_argument(
        "--realtime-priority", type=int, help="of robot and stabilizer (SCHED_FIFO)"
    )
    arguments = parser.parse_args()
    is_measured = run(
        arguments.scenario,
        pace=Pace.LOCKSTEP if arguments.lockstep else Pace.REALTIME,
        priority=arguments.realtime_priority,
        measure=lambda trips, endpoints, stop: alternate(
            trips,
            endpoints,
            rounds=arguments.rounds,
            window_s=arguments.window,
            stop=stop,
        ),
    )
    if not is_measured:
        print("the run ended early, or no stabilizer came", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
