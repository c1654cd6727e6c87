"""Margins compared with simulation: how much softer K may get until the robot sways.

    python -m benchmarks.margins FOLDER [--robot walker] [--profiles ideal,harmonic]
                                 [--delays 1,2,3] [--jobs 2]

For each servo profile and delay of the loop, K is made softer until the robot sways on
firm ground: its wrench errors exceed five times the sensors' noise. ``margins.svg`` and
a table compare this K with that of ``surefoot margins``. Delays alone and trains of
missed ticks are compared as well.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.scenario_robot import Delay, Sensors
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.simulation import Simulation
from surefoot.stabilizer.margins.margins import compute_margins
from surefoot.stabilizer.whole_body.controller import WholeBodyController

DURATION_S = 3.0
SEEN_S = 1.0
"""Duration at the end of a run over which errors are measured [s]."""
NOISE_N, NOISE_NM = 0.2, 0.01
"""Low noise: slow drives then also sway within their speed limit. At the limit they do
not yield further, and the foot forces go to and fro by a few newtons [N, N m]."""
SWAYS = 5.0 * np.array(([NOISE_N] * 3 + [5.0 * NOISE_NM] * 3) * 2)
"""Rms of wrench errors above which the robot sways, both feet [N, N m]."""
BISECTIONS = 6
RANGE = 2.0
"""Largest ratio between the computed factor and those that are tried."""
MOST_TICKS = 12
LINES, MARKS = ("-", "--"), ("o", "x")


class Missing:
    """A controller of which only some answers get through."""

    def __init__(self, controller: WholeBodyController, missed: int) -> None:
        """Let one answer through, then miss the next ones."""
        self._controller, self._missed = controller, missed
        self._tick, self._sent = 0, np.zeros(0)

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin."""
        self._sent = q_command.copy()
        self._controller.start(snapshot, q_command)

    def step(self, snapshot: Snapshot, reference: Reference | None = None) -> Array:
        """Answer every tick; missed ticks repeat the last answer that got through."""
        answer = self._controller.step(snapshot, reference)
        if self._tick % (self._missed + 1) == 0:
            self._sent = answer.q_command.copy()
        self._tick += 1
        return self._sent


@dataclass(frozen=True)
class Case:
    """A robot with a servo profile and a delay of its loop."""

    robot: str
    profile: str
    delay_ticks: int

    def load(self) -> Robot:
        """Load the robot, with a gate that lets every delay pass."""
        robot = load_robot(self.robot, servo_profile=self.profile)
        gate = msgspec.structs.replace(
            robot.file.gate, max_loop_delay_s=None, max_command_age_s=0.1
        )
        return replace(robot, file=msgspec.structs.replace(robot.file, gate=gate))

    def errors(self, factor: float, *, missed: int = 0) -> Array:
        """Return the rms wrench errors with scaled K: (12,), infinite after a fall.

        Args:
            factor: on all of K.
            missed: number of missed ticks after each answered one.
        """
        robot = self.load()
        settings = softened(factor)
        scenario = Scenario(
            name="margins",
            duration_s=DURATION_S,
            sensors=Sensors(force_noise_n=NOISE_N, moment_noise_nm=NOISE_NM),
            delay=Delay(command_ms=1e3 * robot.period_s * self.delay_ticks),
        )
        sim = Simulation(robot, scenario, settings=settings)
        controller = WholeBodyController(robot, settings)
        outer: Any = Missing(controller, missed) if missed else controller
        seen: list[Array] = []
        while not sim.finished:
            sim.step(outer)
            if sim.time_s > DURATION_S - SEEN_S:
                seen.append(controller.observer.state.F_meas - controller.tsid.F_id)
        if sim.fell:
            return np.full(12, np.inf)
        rms: Array = np.std(seen, axis=0)
        return rms

    def factor(self) -> float:
        """Return the computed factor on K at which the robot should sway."""
        found = compute_margins(
            self.load(), softened(1.0), delay_ticks=self.delay_ticks
        ).gain_db
        return 0.0 if found is None else float(10.0 ** (-found / 20.0))

    def measured_factor(self, computed: float) -> float:
        """Return the factor on K at which it sways in simulation, by bisection."""
        low, high = computed / RANGE, computed * RANGE
        for _ in range(BISECTIONS):
            middle = (low * high) ** 0.5
            if is_calm(self.errors(middle)):
                high = middle
            else:
                low = middle
        return float((low * high) ** 0.5)


def softened(factor: float) -> ControllerSettings:
    """Return the default settings with K times a factor."""
    gains = [factor * k for k in build_settings({}, overrides=[]).dik.k_force]
    return build_settings({}, overrides=[f"dik.k_force={gains}"])


def both_factors(case: Case) -> tuple[float, float]:
    """Return the computed and the measured factor of a case."""
    computed = case.factor()
    return computed, case.measured_factor(computed)


def borne(case: Case) -> dict[str, tuple[int, int]]:
    """Return the computed and measured limits of delay and missed ticks [ticks]."""
    robot = case.load()
    found = compute_margins(robot, softened(1.0))

    def later(ticks: int) -> bool:
        return is_calm(replace(case, delay_ticks=ticks).errors(1.0))

    def missing(ticks: int) -> bool:
        return is_calm(case.errors(1.0, missed=ticks))

    delay = last(later, first=1)
    missed = last(missing, first=0)
    computed = round(1e-3 * found.loop_delay_ms / robot.period_s)
    return {"delay": (computed, delay), "missed": (found.missed_ticks, missed)}


def is_calm(rms: Array) -> bool:
    """Return whether wrench errors are those of a robot that does not sway."""
    return bool((rms <= SWAYS).all())


def last(holds: Callable[[int], bool], *, first: int) -> int:
    """Return the last number, from ``first`` on, up to which a condition holds."""
    number = first
    while number < MOST_TICKS and holds(number + 1):
        number += 1
    return number


def _draw(
    found: dict[Case, tuple[float, float]],
    robot: str,
    profiles: list[str],
    delays: list[int],
    *,
    folder: Path,
) -> None:
    """Draw computed and simulated factors over the delay."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 3.4), layout="constrained")
    axes: Any = figure.subplots()
    for index, profile in enumerate(profiles):
        pairs = np.array([found[Case(robot, profile, d)] for d in delays])
        line = f"C{index}{LINES[index % len(LINES)]}"
        axes.plot(delays, pairs[:, 0], line, label=f"{profile}, computed")
        mark = f"C{index}{MARKS[index % len(MARKS)]}"
        axes.plot(delays, pairs[:, 1], mark, ms=8, label=f"{profile}, simulated")
    axes.set(
        title=f"{robot}: below this the robot sways",
        xlabel="delay of the loop [ticks]",
        ylabel="factor on K",
        xticks=delays,
        ylim=(0.0, None),
    )
    axes.axhline(1.0, color="gray", lw=1.0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "margins.svg", metadata={"Date": None})


def main() -> int:
    """Run everything, print a table and draw the figure."""
    from joblib import Parallel, delayed

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", default="walker")
    parser.add_argument("--profiles", default="ideal,harmonic")
    parser.add_argument("--delays", default="1,2,3")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    profiles = arguments.profiles.split(",")
    delays = [int(text) for text in arguments.delays.split(",")]
    cases = [Case(arguments.robot, p, d) for p in profiles for d in delays]
    work = Parallel(n_jobs=arguments.jobs)
    found = dict(zip(cases, work(delayed(both_factors)(c) for c in cases), strict=True))
    for case, (computed, measured) in found.items():
        print(
            f"{case.robot} {case.profile}, {case.delay_ticks} ticks: sways at K x "
            f"{computed:.3f} computed, {measured:.3f} simulated "
            f"({100.0 * (computed / measured - 1.0):+.0f} %)"
        )
    prompt = [Case(arguments.robot, profile, 1) for profile in profiles]
    for case, kinds in zip(
        prompt, work(delayed(borne)(c) for c in prompt), strict=True
    ):
        for kind, (computed, measured) in kinds.items():
            print(
                f"{case.robot} {case.profile}: bears {kind} of {computed} ticks "
                f"computed, {measured} simulated"
            )
    _draw(found, arguments.robot, profiles, delays, folder=arguments.folder)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
