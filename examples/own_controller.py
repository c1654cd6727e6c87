"""A controller of your own: level the torso with the ankles alone.

    python examples/own_controller.py [PLOT.png [SCENARIO]]

The same class runs from the command line, in one process or as a process of its own
on the bus, in sweeps and in replays:

    surefoot run tilt-sine-pitch --controller examples/own_controller.py:AnkleController
"""

from __future__ import annotations

import sys

import numpy as np

import surefoot as sf


class AnkleController:
    """Turn both ankles against the torso's pitch; all other joints stay.

    A controller needs only ``start`` and ``step``. ``__init__`` may take the robot, or
    robot and settings, or nothing.
    """

    name = "ankle"  # shown in results; the class's name without it
    rate_gain, angle_gain = 1.0, 3.0  # [1], [1/s]

    def __init__(self, robot: sf.Robot) -> None:
        """Find the joints by name: their order is that of the robot file."""
        names = robot.joint_names
        self.ankles = [names.index(f"{s}_ankle_pitch") for s in ("left", "right")]
        self.period_s = robot.period_s

    def start(self, snapshot: sf.Snapshot, q_command: np.ndarray) -> None:
        """Begin at the joint positions that the servos hold: else the robot jumps."""
        self.q = q_command.copy()

    def step(self, snapshot: sf.Snapshot, reference: object = None) -> np.ndarray:
        """Return (n_a,) joint positions [rad]; called once per tick, 1 ms."""
        pitch = 2.0 * snapshot.quat_xyzw[1]  # small angles, world from IMU
        rate = snapshot.angular_velocity[1]
        turn = self.rate_gain * rate + self.angle_gain * pitch
        self.q[self.ankles] += self.period_s * turn
        return self.q


def main(plot: str | None = None, scenario: str = "tilt-sine-pitch") -> None:
    """Compare the controller with ``hold`` and with the whole-body controller."""
    robot = sf.load_robot("walker")
    peaks = {}
    # A class is called with the robot; a fresh object may be given as well.
    for controller in ("hold", AnkleController, "whole-body"):
        run = sf.simulate(robot, scenario, controller=controller)
        result = run.result
        peaks[result.controller] = result.base_tilt_max_deg
        print(
            f"{result.controller:>10}: {run.outcome}, {result.duration_s:.1f} s, "
            f"torso leaned by {result.base_tilt_max_deg:.1f} deg at most"
        )

    if plot is not None:
        import matplotlib as mpl

        mpl.use("Agg")  # draw to a file: needs no screen
        import matplotlib.pyplot as plt

        figure, axis = plt.subplots(figsize=(6, 3), layout="tight")
        axis.barh(list(peaks), list(peaks.values()))
        axis.set_xlabel(f"largest tilt of the torso in {scenario} [deg]")
        figure.savefig(plot, dpi=120)
        print(f"wrote {plot}")


if __name__ == "__main__":
    main(*sys.argv[1:])
