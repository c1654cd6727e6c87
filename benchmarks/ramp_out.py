"""How a stabilizer that is asked to stop should leave the robot.

    python -m benchmarks.ramp_out [SCENARIO...] [--moments 10] [--seed 0]

One run per scenario, in one process. At every moment the run is split (a fork), once
for each way of stopping, and watched for four more seconds:

- ``hold``: the last posture, at once.
- ``coast T``: the last motion goes on, slower and slower, until it stands still.
- ``balance T``: the controller goes on answering, and less and less of the motion it
  asks for is followed.

The table tells falls, the largest lean and the mean time the robot stayed up.
"""

from __future__ import annotations

import argparse
import math
import os
import pickle
import sys
from typing import NamedTuple

import numpy as np

from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.snapshot import Delivery
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.stabilizer.factory import make_controller

SCENARIOS = (
    "standing",
    "moving-platform-slow",
    "two-platforms-slow",
    "moving-platform-fast",
)
WAYS = (
    ("hold", 0.0),
    ("coast", 0.05),
    ("coast", 0.2),
    ("coast", 0.5),
    ("balance", 0.05),
    ("balance", 0.2),
    ("balance", 0.5),
    ("balance", 1.0),
)
WATCHED_S = 4.0
"""From the request on, however long the way takes."""
IMPACT_S = 0.3
"""The largest foot force counts for so long after the command stands still."""
EARLIEST_S = 1.5
LATEST_S = 8.0


class Ending(NamedTuple):
    """What came of one stop."""

    fell: bool
    up_s: float
    lean_deg: float
    force_n: float
    step_rad: float


class Run:
    """Plant and controller in one process, which can be stopped in several ways."""

    def __init__(self, scenario: str, seed: int) -> None:
        """Start a run of a shipped scenario."""
        self.robot = load_robot("walker")
        self.plant = SimulatedRobot(self.robot, load_scenario(scenario), seed=seed)
        self._controller = make_controller(
            "whole-body", self.robot, ControllerSettings()
        )
        self._controller.start(self.plant.sense(), self.plant.held_posture)
        self._delivery = Delivery()
        self._commands: dict[int, np.ndarray] = {}
        self._command = self._before = self.plant.held_posture.copy()

    def tick(self) -> None:
        """Balance for a tick."""
        self._follow(self._ask())

    def end(self, way: str, seconds: float) -> Ending:
        """Stop in one of the ways, and look on."""
        ticks = round(seconds / self.robot.period_s)
        motion = self._command - self._before
        asked = self._command
        begin_s, lean, force, step = self.plant.time_s, 0.0, 0.0, 0.0
        end_s = begin_s + WATCHED_S
        fade = 0
        while not self.plant.finished and self.plant.time_s < end_s:
            fade += 1
            share = max(0.0, 1.0 - fade / ticks) if ticks else 0.0
            if way == "balance" and share > 0.0:
                before, asked = asked, self._ask()
                motion = asked - before
            step = max(step, share * float(np.abs(motion).max()))
            self._follow(self._command + share * motion)
            truth = self.plant.truth()
            lean = max(lean, math.degrees(math.acos(min(1.0, truth.upright))))
            if self.plant.time_s < begin_s + seconds + IMPACT_S:
                force = max(force, *truth.normal_forces)
        up_s = self.plant.time_s - begin_s
        return Ending(self.plant.fell, up_s, lean, force, step)

    def _ask(self) -> np.ndarray:
        snapshot, _ = self._delivery.deliver(
            self.plant.sense(), self.plant.unread_sensors
        )
        return self._controller.step(snapshot).q_command.copy()

    def _follow(self, q_command: np.ndarray) -> None:
        plant = self.plant
        self._before, self._command = self._command, q_command
        self._commands[plant.tick] = q_command
        due = plant.commands_needed(plant.tick)
        if due in self._commands:
            plant.apply(self._commands.pop(due), tick=due)
        plant.step()


def split(run: Run, way: str, seconds: float) -> Ending:
    """The end of a run in a process of its own, which leaves this one as it is."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        with os.fdopen(writer, "wb") as out:
            pickle.dump(tuple(run.end(way, seconds)), out)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as come:
        ending = Ending(*pickle.load(come))
    os.waitpid(child, 0)
    return ending


def study(scenario: str, moments: int, seed: int) -> None:
    """Print the table of a scenario."""
    run = Run(scenario, seed)
    rng = np.random.default_rng(seed)
    latest_s = min(LATEST_S, load_scenario(scenario).duration_s - WATCHED_S - 1.0)
    found: dict[tuple[str, float], list[Ending]] = {way: [] for way in WAYS}
    for moment_s in np.sort(rng.uniform(EARLIEST_S, latest_s, moments)):
        while run.plant.time_s < moment_s and not run.plant.finished:
            run.tick()
        if run.plant.finished:
            break
        for way in WAYS:
            found[way].append(split(run, *way))
    print(f"\n{scenario}: {moments} moments, seed {seed}")
    print("way            fell  up mean   lean mean/max   force mean/max   step max")
    for (way, seconds), ends in found.items():
        if not ends:
            continue
        lean = [e.lean_deg for e in ends]
        force = [e.force_n for e in ends]
        print(
            f"{way:<8} {seconds:4.2f} {sum(e.fell for e in ends):3d}/{len(ends):<3d}"
            f"{np.mean([e.up_s for e in ends]):6.2f} s"
            f"{np.mean(lean):8.2f} {max(lean):6.2f} deg"
            f"{np.mean(force):8.0f} {max(force):6.0f} N"
            f"{1e3 * max(e.step_rad for e in ends):8.2f} mrad",
            flush=True,
        )


def main() -> int:
    """Read the command line and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--moments", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for scenario in arguments.scenarios:
        study(scenario, arguments.moments, arguments.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
