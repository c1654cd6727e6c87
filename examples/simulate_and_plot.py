"""Run a scenario and plot what the feet feel.

python examples/simulate_and_plot.py [PLOT.png [SCENARIO]]
"""

from __future__ import annotations

import sys

import surefoot as sf

NORMAL = [2, 8]  # vertical force of the left and right foot, see below


def main(plot: str | None = None, scenario: str = "moving-platform-slow") -> None:
    """Simulate, print the figures and plot the forces."""
    robot = sf.load_robot("walker")
    # One process, no bus. A seed fixes the sensor noise: the same call gives the same
    # numbers, bit for bit.
    run = sf.simulate(robot, scenario, controller="whole-body", seed=3)
    print(f"{run.outcome} after {run.result.duration_s:g} s")
    # None for runs of less than one second: the error counts from 1 s on.
    print("CoM error rms [mm], x y z:", run.result.com_error_rms_mm)

    # A signal is an array with one row per tick. A wrench is [force; moment] of the
    # ground on the sole, in the sole's frame; the left foot comes first.
    measured = run.signals["F_meas"][:, NORMAL]
    desired = run.signals["F_id"][:, NORMAL]
    time_s = run.signals.time_s
    print(f"{len(measured)} ticks of {1e3 * robot.period_s:g} ms")

    if plot is not None:
        import matplotlib as mpl

        mpl.use("Agg")  # draw to a file: needs no screen
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(
            2, sharex=True, figsize=(8, 5), layout="constrained"
        )
        for axis, side in zip(axes, ("left", "right"), strict=True):
            column = 0 if side == "left" else 1
            axis.plot(time_s, measured[:, column], label="measured")
            axis.plot(time_s, desired[:, column], label="desired", linewidth=1)
            axis.set_ylabel(f"{side} normal force [N]")
        figure.legend(
            *axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2
        )
        axes[1].set_xlabel("time [s]")
        figure.savefig(plot, dpi=120)
        print(f"wrote {plot}")


if __name__ == "__main__":
    main(*sys.argv[1:])
