"""A task of your own: the left hand stays at a point while the robot balances.

    python examples/hand_task.py [SCENARIO]

The whole-body controller solves two QPs every millisecond. A task adds rows to both: a
Jacobian J, its drift, and the wanted values of J v and of its rate.
"""

from __future__ import annotations

import sys

import numpy as np

import surefoot as sf
from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.control.tasks import Task
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController

FORWARD_UP_M = np.array([0.15, 0.0, 0.10])


class HandTask(Task):
    """Keeps a frame's origin at a point of the stance frame."""

    size = 3

    def __init__(self, frame_id: int, target: Array) -> None:
        """Set the frame and its target.

        Args:
            frame_id: from :meth:`RobotModel.frame_id`.
            target: (3,) point in the stance frame [m]; may be written at any time.
        """
        self.frame_id = frame_id
        self.target = target
        self.acceleration_weights = np.full(3, 0.1)
        self.velocity_weights = np.full(3, 30.0)
        self.kp, self.kd = 50.0, 14.0  # [1/s^2], [1/s]
        self.gain = 2.0  # [1/s]

    def jacobian(self, dynamics: Dynamics) -> Mat:
        """Return (3, n_v): velocity of the hand in world axes."""
        return dynamics.frame_jacobian(self.frame_id)[:3]

    def drift(self, dynamics: Dynamics) -> Array:
        """Return (3,) [m/s^2]."""
        return dynamics.frame_drift(self.frame_id)[:3]

    def error(self, dynamics: Dynamics) -> Array:
        """Return (3,) vector from the hand to its target [m]."""
        _, position = dynamics.frame_placement(self.frame_id)
        return self.target - position

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        """Write a PD law for the first QP [m/s^2]."""
        velocity = self.jacobian(dynamics) @ dynamics.v
        out[:] = self.kp * self.error(dynamics) - self.kd * velocity

    def velocity(
        self, dynamics: Dynamics, stance: Stance, q_command: Array, out: Array
    ) -> None:
        """Write a P law for the second QP [m/s]."""
        out[:] = self.gain * self.error(dynamics)


def reaching_controller(robot: sf.Robot) -> tuple[WholeBodyController, HandTask]:
    """Make a controller whose left hand reaches forward and up.

    Args:
        robot: loaded robot with a link ``left_hand``.
    """
    model = RobotModel(robot)
    dynamics = Dynamics(model)
    dynamics.update(model.nominal_configuration(), np.zeros(model.n_v))
    hand = model.frame_id("left_hand")
    _, at_rest = dynamics.frame_placement(hand)
    task = HandTask(hand, at_rest + FORWARD_UP_M)
    settings = sf.ControllerSettings()
    return WholeBodyController(robot, settings, extra_tasks=[task]), task


def main(scenario: str = "moving-platform-slow") -> None:
    """Balance, and print how near the hand is to its target at the end.

    Args:
        scenario: shipped name, or the path of a scenario file.
    """
    robot = sf.load_robot("walker")
    controller, task = reaching_controller(robot)
    run = sf.simulate(robot, scenario, controller=controller)
    before_mm = 1e3 * np.linalg.norm(FORWARD_UP_M)
    after_mm = 1e3 * np.linalg.norm(task.error(controller.dynamics))
    print(f"{run.scenario.name}: {run.outcome}")
    print(f"hand to target: {before_mm:.1f} mm at first, {after_mm:.1f} mm at the end")


if __name__ == "__main__":
    main(*sys.argv[1:])
