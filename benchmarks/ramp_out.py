"""Comparison of ways in which a stabilizer leaves the robot when asked to stop.

    python -m benchmarks.ramp_out [SCENARIO...] [--moments 10] [--seed 0]

One run per scenario, in one process. At every moment the run is forked, once for each
way of stopping, and watched for four more seconds:

- ``hold``: the robot holds the last posture at once.
- ``coast T``: the last motion goes on, slower and slower, until it stands still.
- ``balance T``: the controller goes on answering; a shrinking share of the motion that
  it asks for is followed.

The table shows falls, the mean time for which the robot stayed up, lean, foot force and
the largest step of the command.
"""

from __future__ import annotations

import argparse
import math
import os
import pickle
import sys
from typing import NamedTuple

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.simulation import Simulation
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
"""Observation time from the request on, however long the stop takes [s]."""
IMPACT_S = 0.3
"""The largest foot force counts until this time after the command stands still [s]."""
EARLIEST_S = 1.5
LATEST_S = 8.0


class Ending(NamedTuple):
    """Figures of one stop."""

    fell: bool
    up_s: float
    lean_deg: float
    force_n: float
    step_rad: float


class Run:
    """A run whose controller can be stopped in several ways."""

    def __init__(self, scenario: str, seed: int) -> None:
        """Start a run of a shipped scenario."""
        self.sim = Simulation("walker", scenario, seed=seed)
        self._law = make_controller("whole-body", self.sim.robot, ControllerSettings())
        self._command = self._before = self.sim.robot.nominal.copy()
        self._way, self._share = "", 1.0
        self._motion = np.zeros(self.sim.robot.n_a)
        self._asked = self._command

    def start(self, snapshot: Snapshot, q_command: np.ndarray) -> None:
        """Begin as the whole-body controller does."""
        self._law.start(snapshot, q_command)

    def step(self, snapshot: Snapshot) -> np.ndarray:
        """Balance; once stopped, go on with less and less motion."""
        if not self._way:
            command = self._law.step(snapshot).q_command.copy()
        else:
            if self._way == "balance" and self._share > 0.0:
                before = self._asked
                self._asked = self._law.step(snapshot).q_command.copy()
                self._motion = self._asked - before
            command = self._command + self._share * self._motion
        self._before, self._command = self._command, command
        return command

    def tick(self) -> None:
        """Advance a tick."""
        self.sim.step(self)

    def end(self, way: str, seconds: float) -> Ending:
        """Stop in one of the ways, and watch."""
        sim = self.sim
        ticks = round(seconds / sim.robot.period_s)
        self._way, self._asked = way, self._command
        self._motion = self._command - self._before
        begin_s, lean, force, step = sim.time_s, 0.0, 0.0, 0.0
        end_s = begin_s + WATCHED_S
        fade = 0
        while not sim.finished and sim.time_s < end_s:
            fade += 1
            self._share = max(0.0, 1.0 - fade / ticks) if ticks else 0.0
            self.tick()
            step = max(step, float(np.abs(self._command - self._before).max()))
            truth = sim.truth
            lean = max(lean, math.degrees(math.acos(min(1.0, truth.upright))))
            if sim.time_s < begin_s + seconds + IMPACT_S:
                force = max(force, *truth.normal_forces)
        return Ending(sim.fell, sim.time_s - begin_s, lean, force, step)


def split(run: Run, way: str, seconds: float) -> Ending:
    """End a run in a forked process; the run of this process stays as it is."""
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
        while run.sim.time_s < moment_s and not run.sim.finished:
            run.tick()
        if run.sim.finished:
            break
        for way in WAYS:
            found[way].append(split(run, *way))
    print(f"\n{scenario}: {moments} moments, seed {seed}")
    print("way            fell  up mean   lean mean/max   force mean/max   step max")
    for (name, seconds), ends in found.items():
        if not ends:
            continue
        lean = [e.lean_deg for e in ends]
        force = [e.force_n for e in ends]
        print(
            f"{name:<8} {seconds:4.2f} {sum(e.fell for e in ends):3d}/{len(ends):<3d}"
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
