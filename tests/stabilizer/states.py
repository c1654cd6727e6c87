"""Random states of the robot, seeded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat
from surefoot.stabilizer.model import N_BASE_V, RobotModel


@dataclass(frozen=True)
class State:
    """Configuration (7 + n_a,) and velocity (n_v,), model order."""

    q: Array
    v: Array

    @property
    def base_rotation(self) -> Mat:
        """Return (3, 3) the rotation of the base."""
        rotation: Mat = pin.Quaternion(self.q[3:7]).toRotationMatrix()
        return rotation


def nominal_state(model: RobotModel) -> State:
    """Return the nominal posture on level ground, at rest."""
    return State(q=model.nominal_configuration(), v=np.zeros(model.n_v))


def states_anywhere(model: RobotModel, *, count: int, seed: int) -> Iterator[State]:
    """Yield any attitude, joints over their whole range, and speeds around 1 (SI)."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        quat = rng.normal(size=4)
        q = np.concatenate(
            (
                rng.normal(size=3),
                quat / np.linalg.norm(quat),
                rng.uniform(model.lower, model.upper),
            )
        )
        yield State(q=q, v=rng.normal(size=model.n_v))


def states_near_stance(
    model: RobotModel, *, count: int, seed: int, spread: float, speed: float
) -> Iterator[State]:
    """Yield random states around the nominal stance.

    Args:
        model: the robot.
        count: number of states.
        seed: seed of the generator.
        spread: standard deviation of base pose and joints [m, rad].
        speed: standard deviation of every velocity [m/s, rad/s].
    """
    rng = np.random.default_rng(seed)
    for _ in range(count):
        step = spread * rng.normal(size=model.n_v)
        q = pin.integrate(model.pin_model, model.nominal_configuration(), step)
        q[7:] = np.clip(q[7:], model.lower, model.upper)
        yield State(q=q, v=speed * rng.normal(size=model.n_v))


def stepped(model: RobotModel, q: Array, *, along: Array) -> Array:
    """Return (7 + n_a,) q moved by a tangent vector, base part in base coordinates."""
    moved: Array = pin.integrate(model.pin_model, q, along)
    return moved


def unit(model: RobotModel, index: int) -> Array:
    """Return (n_v,) a velocity with one entry 1, the others 0."""
    direction = np.zeros(N_BASE_V + model.n_a)
    direction[index] = 1.0
    return direction
