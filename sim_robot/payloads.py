"""Loads that the robot carries, from the start or from some time on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.scenario_robot import Payload
from surefoot.schemas.validation import nearest
from surefoot.sim_robot.errors import ScenarioError
from surefoot.sim_robot.ticks import SIM_STEP_S

DENSITY_KG_M3 = 2000.0
NOT_YET_KG = 1e-6
"""What a load has until it is grasped."""
_PREFIX = "payload_"


def add_payloads(
    spec: mujoco.MjSpec, robot: Robot, payloads: Sequence[Payload]
) -> None:
    """Fix a ball to each link that carries one.

    Args:
        spec: the robot, not compiled.
        robot: names its file in errors.
        payloads: of the scenario.

    Raises:
        ScenarioError: no such link.
    """
    links = [body.name for body in spec.bodies if body.name != "world"]
    for index, load in enumerate(payloads):
        if load.link not in links:
            raise ScenarioError(
                f"payload[{index}].link: {robot.file.name} has no link {load.link!r}"
                f"{nearest(load.link, links)}; there are {', '.join(links)}",
                field=f"payload[{index}].link",
            )
        mass = load.mass_kg if load.start_s == 0.0 else NOT_YET_KG
        ball = spec.body(load.link).add_body(
            name=f"{_PREFIX}{index}",
            pos=load.offset_m,
            mass=mass,
            ipos=[0.0, 0.0, 0.0],
            inertia=[_inertia(mass)] * 3,
            explicitinertial=True,
        )
        ball.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[_radius(load.mass_kg), 0.0, 0.0],
            mass=0.0,
            contype=0,
            conaffinity=0,
            rgba=[0.85, 0.45, 0.15, 1.0],
        )


def is_payload(name: str) -> bool:
    """Whether a body is a load and no part of the robot."""
    return name.startswith(_PREFIX)


class _Grasp(NamedTuple):
    """A load to come: from which simulation step, on which body, how heavy."""

    step: int
    body: int
    mass: float


class Grasps:
    """Gives loads their mass when their time comes."""

    def __init__(
        self,
        payloads: Sequence[Payload],
        model: mujoco.MjModel,
        *,
        renew: Callable[[mujoco.MjModel], None],
    ) -> None:
        """Look up the loads that are not carried from the start.

        Args:
            payloads: of the scenario.
            model: changed when a load is grasped.
            renew: works out anew what of the model follows from its masses.
        """
        self._model, self._renew = model, renew
        self._coming = [
            _Grasp(
                round(load.start_s / SIM_STEP_S),
                int(model.body(f"{_PREFIX}{index}").id),
                load.mass_kg,
            )
            for index, load in enumerate(payloads)
            if load.start_s > 0.0
        ]

    def apply(self, step: int) -> None:
        """Grasp what is due in simulation step ``step``, counted from zero."""
        if not self._coming:
            return
        due = [grasp for grasp in self._coming if grasp.step <= step]
        if not due:
            return
        self._coming = [grasp for grasp in self._coming if grasp.step > step]
        for grasp in due:
            self._model.body_mass[grasp.body] = grasp.mass
            self._model.body_inertia[grasp.body] = np.full(3, _inertia(grasp.mass))
        self._renew(self._model)


def _radius(mass_kg: float) -> float:
    return float((3.0 * mass_kg / (4.0 * math.pi * DENSITY_KG_M3)) ** (1.0 / 3.0))


def _inertia(mass_kg: float) -> float:
    """Of a solid ball about its middle [kg m^2]."""
    return 0.4 * mass_kg * _radius(mass_kg) ** 2
