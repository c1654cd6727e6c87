"""Effect of killing a process (SIGKILL) at a random moment.

    python -m benchmarks.kill_study [SCENARIO...] [--kills 20] [--seed 0] [--realtime]
                                    [--robot-kills 10]

The processes are real: the commands that a user starts. In each run of a scenario the
stabilizer is killed, a new one is started at once, and the run goes on to its end. The
robot's own record tells what it did meanwhile. Then the robot is killed, and the time
until its stabilizer reports it is measured, with and without ``--reconnect``.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.started import Started, shortened, wait_until
from surefoot.robot_io.bus.bus import loopback_endpoints
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode, RobotStatus
from surefoot.signals import Signals, read_signals

SCENARIOS = ("standing", "moving-platform-slow")
DURATION_S = 14.0
"""Duration of each run: a new process has time to start and to balance [s]."""
EARLIEST_S = 1.5
LATEST_S = 5.0
ROUNDING_RAD = 1e-12
UPRIGHT_RAD = math.radians(5.0)


class Kill(NamedTuple):
    """One kill of the stabilizer, and its consequences."""

    tick: int
    hold_ms: float
    gap_s: float | None
    step_rad: float
    fell_at_s: float | None
    fell_held: bool
    lean_deg: float


class Watch:
    """Reads the robot's public status."""

    def __init__(self, robot: Robot, endpoints: Endpoints) -> None:
        """Prepare to watch; see :meth:`until`."""
        self.observer = Observer(
            robot, endpoints=endpoints, channels=("status",), depth=64
        )

    def until(self, mode: RobotMode, *, tick: int = 0) -> RobotStatus:
        """Wait for a mode at some tick or later."""

        def look() -> RobotStatus | None:
            for sample in self.observer.take():
                status = self.observer.decode(sample)
                assert isinstance(status, RobotStatus)
                if status.mode is RobotMode.OFF and mode is not RobotMode.OFF:
                    raise RuntimeError(f"the run is over: {status.detail}")
                if status.mode is mode and status.tick >= tick:
                    return status
            return None

        found = wait_until(look, what=f"{mode} at tick {tick}")
        assert found is not None
        return found


def kill_once(robot: Robot, scenario: Path, pace: str, tick: int, seed: int) -> Kill:
    """Run a scenario whose stabilizer is killed at a tick and replaced by another."""
    endpoints = loopback_endpoints()
    (locator,) = endpoints.listen
    folder = scenario.parent
    record = folder / "ticks.mcap"
    watch = Watch(robot, endpoints)
    words = ("robot", scenario, "--listen", locator, "--seed", seed, pace)
    dial = ("stabilizer", "--connect", locator, "--wait", 60, pace)
    with (
        Started(folder / "robot.log", *words, "--record-file", record) as plant,
        watch.observer as observer,
        ExitStack() as stack,
    ):
        observer.connect(timeout_s=60.0)  # first: it misses nothing
        first = stack.enter_context(Started(folder / "first.log", *dial))
        watch.until(RobotMode.ACTIVE, tick=tick)
        killed_s = time.monotonic()
        first.signal(signal.SIGKILL)
        held = watch.until(RobotMode.HOLD)
        hold_ms = 1e3 * (time.monotonic() - killed_s)
        gap_s = None
        with Started(folder / "second.log", *dial) as second:
            try:
                taken = watch.until(RobotMode.ACTIVE, tick=held.tick + 1)
                gap_s = (taken.tick - held.tick) * robot.period_s
            except RuntimeError:
                pass  # it fell while it held
            plant.exit_code()
            second.exit_code()
    return _what_came(read_signals(record), held.tick, hold_ms, gap_s, robot)


def _what_came(
    arrays: Signals,
    tick: int,
    hold_ms: float,
    gap_s: float | None,
    robot: Robot,
) -> Kill:
    steps = np.abs(np.diff(arrays["q_command"], axis=0)).max()
    x, y = arrays["true_base_pose"][-1, 3:5]
    lean = math.acos(max(-1.0, 1.0 - 2.0 * (x * x + y * y)))
    ticks = len(arrays["q_command"])
    is_short = ticks < round(DURATION_S / robot.period_s)
    fell_at_s = ticks * robot.period_s if is_short else None
    return Kill(
        tick=tick,
        hold_ms=hold_ms,
        gap_s=gap_s,
        step_rad=float(steps),
        fell_at_s=fell_at_s,
        fell_held=fell_at_s is not None and gap_s is None,
        lean_deg=math.degrees(lean),
    )


def study_stabilizer(
    robot: Robot, scenario: str, pace: str, kills: int, seed: int
) -> bool:
    """Kill the stabilizer again and again; return whether the robot never jumped."""
    rng = np.random.default_rng(seed)
    limit = robot.file.gate.step_limit_rad
    found = []
    print(f"\n{scenario}, {pace[2:]}: kill -9 of the stabilizer", flush=True)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / f"{scenario}.toml"
        path.write_text(shortened(scenario, DURATION_S))
        for index, moment_s in enumerate(rng.uniform(EARLIEST_S, LATEST_S, kills)):
            tick = round(moment_s / robot.period_s)
            try:
                kill = kill_once(robot, path, pace, tick, index)
            except RuntimeError as error:
                print(f"  {error}: too late on a busy machine, once more", flush=True)
                kill = kill_once(robot, path, pace, tick, index)
            found.append(kill)
            gap = "never" if kill.gap_s is None else f"{kill.gap_s:5.2f} s"
            fell = "" if kill.fell_at_s is None else f"  fell at {kill.fell_at_s:.2f} s"
            print(
                f"  at {kill.tick * robot.period_s:5.2f} s: HOLD after "
                f"{kill.hold_ms:6.1f} ms, commanded again after {gap}, largest step "
                f"{1e3 * kill.step_rad:5.2f} mrad, lean at the end "
                f"{kill.lean_deg:5.2f} deg{fell}",
                flush=True,
            )
    holds = [kill.hold_ms for kill in found]
    gaps = [kill.gap_s for kill in found if kill.gap_s is not None]
    step = max(kill.step_rad for kill in found)
    upright = [
        kill
        for kill in found
        if kill.fell_at_s is None and math.radians(kill.lean_deg) < UPRIGHT_RAD
    ]
    print(
        f"  {len(found)} kills: HOLD after median {np.median(holds):.1f}, max "
        f"{max(holds):.1f} ms; largest step {1e3 * step:.2f} of {1e3 * limit:g} mrad; "
        f"without a commander for median {np.median(gaps or [math.nan]):.2f}, max "
        f"{max(gaps, default=math.nan):.2f} s; {len(upright)} upright at the end, "
        f"{sum(kill.fell_held for kill in found)} fell before anybody took over, "
        f"{sum(kill.fell_at_s is not None for kill in found)} fell in all"
    )
    return step <= limit + ROUNDING_RAD


def study_robot(pace: str, kills: int, seed: int) -> None:
    """Kill the robot, and time its stabilizer's report and reaction."""
    rng = np.random.default_rng(seed)
    robot = load_robot("walker")
    said, back = [], []
    for index in range(kills):
        endpoints = loopback_endpoints()
        (locator,) = endpoints.listen
        reconnect = ("--reconnect",) if index % 2 else ()
        words = ("robot", "standing", "--listen", locator, pace)
        dial = ("stabilizer", "--connect", locator, "--wait", 60, pace, *reconnect)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            with Started(folder / "stabilizer.log", *dial) as stabilizer:
                watch = Watch(robot, endpoints)
                with (
                    Started(folder / "robot.log", *words) as plant,
                    watch.observer as observer,
                ):
                    observer.connect(timeout_s=60.0)
                    watch.until(RobotMode.ACTIVE, tick=int(rng.integers(200, 2000)))
                    killed_s = time.monotonic()
                    plant.signal(signal.SIGKILL)
                    stabilizer.wait_for("the robot is gone")
                    said.append(time.monotonic() - killed_s)
                if not reconnect:
                    code = stabilizer.exit_code()
                    if code != 4:
                        raise RuntimeError(f"exit code {code}, expected 4")
                    continue
                with Started(folder / "again.log", *words) as plant:
                    plant.wait_for("waits for a stabilizer")
                    begin_s = time.monotonic()
                    stabilizer.wait_for("in command again")
                    back.append(time.monotonic() - begin_s)
    print(
        f"\n{kills} times kill -9 of the robot, {pace[2:]}: the stabilizer says so "
        f"after median {1e3 * np.median(said):.0f}, max {1e3 * max(said):.0f} ms; with "
        f"--reconnect it commands a robot that is back {np.median(back):.2f} s (max "
        f"{max(back):.2f}) after that one's first word"
    )


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--robot-kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--realtime", action="store_true")
    arguments = parser.parse_args()
    pace = "--realtime" if arguments.realtime else "--lockstep"
    robot = load_robot("walker")
    good = True
    if arguments.kills:
        for scenario in arguments.scenarios:
            good &= study_stabilizer(
                robot, scenario, pace, arguments.kills, arguments.seed
            )
    if arguments.robot_kills:
        study_robot(pace, arguments.robot_kills, arguments.seed)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
