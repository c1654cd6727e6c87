"""Reasons why some goals are not reached: four figures, each about one limit.

    python -m benchmarks.limits FOLDER [--only push] [--seeds 5] [--jobs 2]

``limit-height.svg``: height error on the slow platform over the bandwidth of its
filter, with and without accelerometer noise. ``limit-pitch.svg``: foot force on swaying
ground over the feedback in pitch, for three delays of the command. ``limit-push.svg``:
CoM and centre of pressure after a push along the soles. ``limit-slow.svg``: required
and possible speed of the set-points of slow servos. Runs are those of ``surefoot
sweep``.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.dynamics import SOLE_ROWS
from surefoot.stabilizer.model import N_BASE_V
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from surefoot.studies.cell import Cell, Group, Row, is_up
from surefoot.studies.paper_page import record
from surefoot.studies.store import Task

BANDWIDTHS_RAD_S = (0.2, 0.3, 0.4, 0.55, 0.8, 1.2)
NOISE = "sensors.accel_noise_m_s2"
DELAY = "delay.command_ms"
K_PITCH = (-20.0, -27.5, -35.0, -42.5, -50.0, -57.5, -65.0)
DELAYS_MS = (1.0, 2.0, 3.0)
GROUND = {
    "tilt-sine-pitch": "pitch sine, 120 deg/s",
    "moving-platform-fast": "fast platform",
}
FELL_N = 1e3
"""Force at which a case with a fall is drawn [N]."""
RATES_DEG_S = np.linspace(30.0, 180.0, 51)
SINE_DEG = 8.6
PUSHED = {"whole-body": "C0", "zmp-tuned": "C1"}
SEEN_S = (1.9, 4.0)
EDGE_MM = 10.0
"""Distance of the centre of pressure from a sole's edge that counts as used up."""
FROM_S = 1.0
"""Time from which errors count [s]."""


@dataclass(frozen=True)
class Work:
    """Number of seeds of every case, and of processes."""

    seeds: int
    jobs: int

    def rows(self, cases: list[tuple[Group, str]]) -> list[list[Row]]:
        """Run cases, each a group and one setting, with every seed."""
        from joblib import Parallel, delayed

        flat = Parallel(n_jobs=self.jobs)(
            delayed(Task.run)(Task(Cell(group, seed), "walker", (setting,)))
            for group, setting in cases
            for seed in range(self.seeds)
        )
        size = self.seeds
        return [flat[at : at + size] for at in range(0, len(flat), size)]


def height(work: Work, axes: Any) -> None:
    """Draw the leak of the ground's motion against noise, over the bandwidth."""
    scenario = "moving-platform-slow"
    levels = (0.05, 0.0)
    cases = [
        (Group(scenario, ((NOISE, noise),), "whole-body", "ideal"), setting)
        for noise in levels
        for setting in (f"estimator.height_bandwidth={w}" for w in BANDWIDTHS_RAD_S)
    ]
    rows = work.rows(cases)
    both = [[row["com_error_rms_mm"][2] for row in seeds] for seeds in rows]
    count = len(BANDWIDTHS_RAD_S)
    whole, leak = np.array(both[:count]), np.array(both[count:]).mean(axis=1)
    noise = np.sqrt(np.maximum((whole**2).mean(axis=1) - leak**2, 0.0))
    axes.fill_between(
        BANDWIDTHS_RAD_S, whole.min(axis=1), whole.max(axis=1), color="C0", alpha=0.2
    )
    axes.plot(
        BANDWIDTHS_RAD_S, whole.mean(axis=1), "o-", label="measured, mean and range"
    )
    axes.plot(BANDWIDTHS_RAD_S, leak, "s--", label="without accelerometer noise")
    axes.plot(BANDWIDTHS_RAD_S, noise, "^:", label="difference, in squares")
    axes.axhline(10.0, color="gray", lw=1.0)
    axes.annotate("goal", (BANDWIDTHS_RAD_S[-1], 10.0), va="bottom", ha="right")
    axes.set(
        title="CoM height, slow platform",
        xlabel="bandwidth of the pull to the legs' height [rad/s]",
        ylabel="rms error [mm]",
        ylim=(0.0, None),
    )
    for w, seeds, rest in zip(BANDWIDTHS_RAD_S, whole, leak, strict=True):
        print(
            f"height: {w:4.2f} rad/s  mean {seeds.mean():5.1f}"
            f"  worst {seeds.max():5.1f}  without noise {rest:5.1f} mm"
        )


def pitch(work: Work, grid: Any) -> None:
    """Draw the force deviation over the feedback in pitch, for each delay."""
    cases = [
        (
            Group(scenario, ((DELAY, delay),), "whole-body", "ideal"),
            f"dik.k_force=[-50,-50,-50,-50,{gain},-50]",
        )
        for scenario in GROUND
        for delay in DELAYS_MS
        for gain in K_PITCH
    ]
    rows = iter(work.rows(cases))
    for axes, (scenario, title) in zip(grid, GROUND.items(), strict=True):
        for delay in DELAYS_MS:
            found = [next(rows) for _ in K_PITCH]
            values = [_worst_force(seeds) for seeds in found]
            axes.plot(K_PITCH, values, "o-", label=f"command {delay:g} ms late")
            print(f"pitch: {scenario}, {delay:g} ms: " + _words(K_PITCH, values))
        axes.axvline(-50.0, color="gray", lw=1.0)
        axes.set(
            title=title, xlabel="K in pitch [1/s]", yscale="log", ylim=(5.0, 1.3e3)
        )
    grid[0].set_ylabel(f"force deviation, worst seed [N]; fell: {FELL_N:g}")


def slow(grid: Any) -> None:
    """Draw the speeds that slow servos need on swaying ground, and their limits."""
    robot = load_robot("walker", servo_profile="harmonic")
    profile, axes = robot.servo_profile, grid[0, 0]
    rates = np.radians(RATES_DEG_S)
    for axis, name in enumerate(("roll", "pitch")):
        joint, ratio, damping_s = _fastest_joint(robot, axis)
        omega = rates / np.radians(SINE_DEG)
        demanded = ratio * rates * np.hypot(1.0, omega * damping_s)
        demanded *= np.hypot(1.0, omega * profile.lag_s)
        axes.plot(RATES_DEG_S, demanded, label=f"{name}: {joint}")
        at_120 = np.interp(120.0, RATES_DEG_S, demanded)
        print(f"slow: {name}, 120 deg/s: {joint} {at_120:.2f} rad/s")
    axes.plot(RATES_DEG_S, rates, "--", color="gray", label="the ground itself")
    axes.axhline(profile.velocity_limit_rad_s, color="C3", label="available")
    axes.axvline(120.0, color="gray", lw=1.0)
    axes.set(
        title=f"set-points of slow servos, sines of {SINE_DEG:g} deg",
        xlabel="fastest rate of the ground [deg/s]",
        ylabel="fastest joint [rad/s]",
        ylim=(0.0, None),
    )


def _fastest_joint(robot: Robot, axis: int) -> tuple[str, float, float]:
    """Find the joint that the ground moves fastest while the body is at rest.

    Args:
        robot: in its nominal stance.
        axis: 0 for roll, 1 for pitch of ground under both feet.

    Returns:
        Its name; its rate over the ground's; damping over stiffness of its servo [s].
    """
    controller = WholeBodyController(robot, build_settings({}, overrides=[]))
    model, dynamics = controller.model, controller.dynamics
    dynamics.update(model.nominal_configuration(), np.zeros(model.n_v))
    rate = np.eye(3)[axis]
    r = np.zeros(12)
    for side, rows in enumerate(SOLE_ROWS):
        rotation = dynamics.R_world_sole[side]
        linear = np.cross(rate, dynamics.p_sole[side])
        r[rows] = np.concatenate((linear @ rotation, rate @ rotation))
    solved = controller.dik.solve(
        dynamics, controller.stance, r=r, q_command=model.nominal
    )
    ratios = np.abs(solved.x[N_BASE_V:])[model.to_bus]
    joint = int(ratios.argmax())
    damping_s = (robot.kd + robot.damping)[joint] / robot.kp[joint]
    return robot.joint_names[joint], float(ratios[joint]), float(damping_s)


def _worst_force(seeds: list[Row]) -> float:
    if not all(is_up(row) for row in seeds):
        return FELL_N
    return float(max(max(row["force_deviation_rms_n"]) for row in seeds))


def _words(levels: tuple[float, ...], values: list[float]) -> str:
    pairs = zip(levels, values, strict=True)
    return ", ".join(
        f"{level:g}: " + ("fell" if value == FELL_N else f"{value:.0f} N")
        for level, value in pairs
    )


def push(grid: Any) -> None:
    """Draw CoM and centre of pressure after pushes to the front and to the back."""
    for column, (direction, name) in enumerate({0.0: "front", 180.0: "back"}.items()):
        upper, lower = grid[0, column], grid[1, column]
        for variant, colour in PUSHED.items():
            pushed = (("push.0.direction_deg", direction),)
            arrays = record("push-standing", variant, pushed)
            time_s = arrays["time_s"]
            soles = arrays["true_sole_left"] + arrays["true_sole_right"]
            com = 1e3 * (arrays["true_com"] - 0.5 * soles)[:, 0]
            rest = com[time_s >= FROM_S][0]
            upper.plot(time_s, com - rest, colour, label=variant)
            pressure = _pressure_mm(arrays) - rest
            heel, toe = _reach_mm(rest)
            edge = (pressure < heel + EDGE_MM) | (pressure > toe - EDGE_MM)
            lower.plot(time_s, pressure, colour, lw=0.8)
            error = com[time_s >= FROM_S] - rest
            print(
                f"push to the {name}: {variant} {_rms(error):.1f} mm rms, at most "
                f"{np.abs(error).max():.0f} mm; at the edge for "
                f"{1e3 * (time_s[1] - time_s[0]) * edge[time_s >= FROM_S].sum():.0f} ms"
            )
        for edge in (heel, toe):
            lower.axhline(edge, color="gray", lw=1.0)
        upper.set_title(f"push of 20 N s to the {name}")
        lower.set_xlabel("time [s]")
        upper.set_xlim(SEEN_S)
    grid[0, 0].set_ylabel("CoM [mm]")
    grid[1, 0].set_ylabel("centre of pressure, edges [mm]")


def _pressure_mm(arrays: dict[str, Array]) -> Array:
    """Return the centre of pressure of both level soles along x, from their middle."""
    left, right = arrays["true_F"][:, :6], arrays["true_F"][:, 6:]
    force = np.maximum(left[:, 2] + right[:, 2], 1.0)
    pressure: Array = -1e3 * (left[:, 4] + right[:, 4]) / force
    return pressure


def _reach_mm(com: float) -> tuple[float, float]:
    """Return the places of heel and toe relative to the CoM [mm].

    Args:
        com: place of the CoM from the middle of the soles [mm].
    """
    half = 1e3 * load_robot("walker").left.half_length_m
    return -half - com, half - com


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> int:
    """Run everything and write the figures."""
    from matplotlib.figure import Figure

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", choices=("push", "height", "pitch", "slow"))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    work = Work(arguments.seeds, arguments.jobs)
    arguments.folder.mkdir(parents=True, exist_ok=True)

    def write(
        name: str,
        draw: Callable[[Any], None],
        *,
        size: tuple[float, float],
        shape: tuple[int, int] = (1, 1),
        **how: Any,
    ) -> None:
        if arguments.only not in (None, name):
            return
        figure = Figure(figsize=size, layout="constrained")
        grid: Any = figure.subplots(*shape, squeeze=False, **how)
        draw(grid)
        for axes in grid.flat:
            axes.grid(alpha=0.3)
        # Beside the plots: inside, the legend would hide curves.
        figure.legend(
            *grid[0, 0].get_legend_handles_labels(),
            loc="outside right upper",
            fontsize="small",
        )
        figure.savefig(arguments.folder / f"limit-{name}.svg", metadata={"Date": None})

    write("push", push, size=(9.0, 5.2), shape=(2, 2), sharex=True, sharey="row")
    write("height", lambda grid: height(work, grid[0, 0]), size=(6.4, 3.4))
    write(
        "pitch",
        lambda grid: pitch(work, grid[0]),
        size=(9.0, 3.6),
        shape=(1, 2),
        sharey=True,
    )
    write("slow", slow, size=(6.4, 3.4))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
