"""Draws the kinds of ground motion: ``python -m benchmarks.ground_figure``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from surefoot.schemas.arrays import Array
from surefoot.schemas.motions import Motion, PrtsMotion, RecordedMotion, SpectrumMotion
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.sim_robot.conventions import SIM_STEP_S
from surefoot.sim_robot.motion import motion_law
from surefoot.sim_robot.recorded import recorded_track

FILE = Path(__file__).parents[1] / "docs" / "images" / "ground.svg"
TEAL, ORANGE, GREY = "#00796b", "#e65100", "#8a949e"


def sampled(motion: Motion, times: Array) -> tuple[Array, Array]:
    """Return position and velocity at some times, each (n,) in SI."""
    law = motion_law(motion)
    position, velocity = np.array([law(float(t)) for t in times]).T
    return position, velocity


def prts(axes: Sequence[Axes]) -> None:
    """Draw a cycle of the ternary sequence."""
    motion = PrtsMotion(axis="pitch", peak_to_peak_deg=8.0, cycles=1)
    times = np.arange(0.0, 21.0, 0.01)
    angle, rate = sampled(motion, times)
    axes[0].plot(times, np.degrees(angle), color=TEAL)
    axes[1].plot(times, np.degrees(rate), color=ORANGE)
    axes[0].set(title="prts, 8 deg", ylabel="angle [deg]")
    axes[1].set(ylabel="rate [deg/s]")


def sea(axes: Sequence[Axes]) -> None:
    """Draw heave and roll of the deck in sea state 6."""
    times = np.arange(0.0, 120.0, 0.05)
    for ax, axis, colour, unit in (
        (axes[0], "z", TEAL, "m"),
        (axes[1], "roll", ORANGE, "deg"),
    ):
        (motion,) = (
            motion
            for motion in load_scenario("sea-state-6").platform[0].motion
            if isinstance(motion, SpectrumMotion) and motion.axis == axis
        )
        place, _ = sampled(motion, times)
        factor = math.degrees(1.0) if motion.is_rotation else 1.0
        ax.plot(times, factor * place, color=colour)
        ax.set(ylabel=f"{axis} [{unit}]")
    axes[0].set(title="spectrum, sea state 6")


def shaken(axes: Sequence[Axes]) -> None:
    """Draw a record: the content of the file, and the motion of the ground."""
    motion = _recorded(load_scenario("strong-motion"))[0]
    track = recorded_track(motion)
    times = SIM_STEP_S * np.arange(len(track.position))
    axes[0].plot(times, track.position, color=TEAL)
    axes[1].plot(times, track.acceleration, color=ORANGE, linewidth=0.5)
    axes[0].set(title="recorded, strong-motion", ylabel="x [m]")
    axes[1].set(ylabel="acceleration [m/s²]")


def pulses(axes: Sequence[Axes]) -> None:
    """Draw the passenger pulses."""
    for name, colour, style in (
        ("bus-start", TEAL, "-"),
        ("bus-start-hard", ORANGE, "-"),
        ("bus-brake", TEAL, "--"),
        ("bus-brake-hard", ORANGE, "--"),
    ):
        track = recorded_track(_recorded(load_scenario(name))[0])
        times = SIM_STEP_S * np.arange(len(track.position))
        shown = times < 8.0
        for panel, values in zip(
            axes, (track.velocity, track.acceleration), strict=True
        ):
            panel.plot(times[shown], values[shown], style, label=name, color=colour)
    axes[0].set(title="recorded, passenger pulses", ylabel="speed [m/s]")
    axes[1].set(ylabel="acceleration [m/s²]")
    axes[1].legend(fontsize=7, frameon=False)


def _recorded(scenario: Scenario) -> list[RecordedMotion]:
    motions = scenario.platform[0].motion
    return [motion for motion in motions if isinstance(motion, RecordedMotion)]


def draw(file: Path) -> None:
    """Draw the whole figure."""
    plt.rcParams["svg.hashsalt"] = "surefoot"
    figure, grid = plt.subplots(4, 2, figsize=(9.0, 9.5), layout="constrained")
    for row, panel in zip(grid, (prts, sea, shaken, pulses), strict=True):
        panel(row)
    for axes in grid.flat:
        axes.spines[["top", "right"]].set_visible(False)
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        axes.set_xlabel("time [s]")
    figure.savefig(file, metadata={"Date": None})


if __name__ == "__main__":
    draw(FILE)
