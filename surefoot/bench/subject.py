"""The measures of a robot that benchmarks put its figures in proportion to."""

from __future__ import annotations

import math
from dataclasses import dataclass

from surefoot.schemas.scenario import Scenario


@dataclass(frozen=True)
class Subject:
    """A robot, or a person, that stands.

    Attributes:
        mass_kg: of all of it [kg].
        com_height_m: centre of mass over the soles [m].
        base_depth_m: from below the centre of mass to the nearer edge ahead or behind,
            over which it tips [m].
        base_width_m: the same to the side [m].
    """

    mass_kg: float
    com_height_m: float
    base_depth_m: float
    base_width_m: float

    def base_m(self, direction_deg: float) -> float:
        """Distance to the edge of tipping, the nearer one, for a push [m].

        Args:
            direction_deg: 0 and 180 ahead and back, 90 and 270 to the sides.
        """
        angle = math.radians(direction_deg)
        depth, width = abs(math.cos(angle)), abs(math.sin(angle))
        least = 1e-9
        return min(
            self.base_depth_m / max(depth, least), self.base_width_m / max(width, least)
        )


def subject_of(robot: str, *, servo_profile: str | None = None) -> Subject:
    """Measure a robot in its nominal stance.

    Args:
        robot: shipped name or path of a robot file.
        servo_profile: any; the measures are the same.

    Raises:
        RobotFileError: no such robot, or its files contradict each other.
    """
    from surefoot.robot_io.robot import load_robot
    from surefoot.sim_robot.plant import Plant

    model = load_robot(robot, servo_profile=servo_profile)
    plant = Plant(model, Scenario(name="stance", duration_s=1.0), seed=0)
    x, y, height = plant.com_reference.tolist()
    soles = plant.view.sole_left, plant.view.sole_right
    feet = list(zip(soles, (model.left, model.right), strict=True))
    middle = 0.5 * (soles[0] + soles[1])
    front = max(p[0] + foot.half_length_m for p, foot in feet) - middle[0]
    back = min(p[0] - foot.half_length_m for p, foot in feet) - middle[0]
    left = max(p[1] + foot.half_width_m for p, foot in feet) - middle[1]
    right = min(p[1] - foot.half_width_m for p, foot in feet) - middle[1]
    return Subject(
        mass_kg=plant.world.weight / -plant.world.model.opt.gravity.item(2),
        com_height_m=height,
        base_depth_m=float(min(front - x, x - back)),
        base_width_m=float(min(left - y, y - right)),
    )


PERSON = Subject(
    mass_kg=81.4, com_height_m=1.003, base_depth_m=0.111, base_width_m=0.1665
)
"""The person of medium size that DYSTURBANCE puts robots in proportion to; mass and
centre of mass from the body parts in its published program."""


@dataclass(frozen=True)
class Proportion:
    """A robot's measures over a person's, in the combinations that pushes scale with.

    Attributes:
        force: of what a body bears before it tips: weight times base over height.
        energy: of lifting the centre of mass over the edge of the base.
        way: of the centre of mass' height.
    """

    force: float
    energy: float
    way: float


def proportion(subject: Subject, *, direction_deg: float) -> Proportion:
    """Return a robot's measures over those of :data:`PERSON`.

    Implements the normalisation of DYSTURBANCE (10.3389/frobt.2022.817870): a figure
    divided by its factor is what it would be for a person, so that robots compare.

    Args:
        subject: the robot.
        direction_deg: of the push.
    """
    ours, theirs = (_tipping(who, direction_deg) for who in (subject, PERSON))
    return Proportion(
        force=ours[0] / theirs[0],
        energy=ours[1] / theirs[1],
        way=subject.com_height_m / PERSON.com_height_m,
    )


def _tipping(who: Subject, direction_deg: float) -> tuple[float, float]:
    """Force and energy of tipping, both over gravity [kg, kg m]."""
    base, height = who.base_m(direction_deg), who.com_height_m
    force = who.mass_kg * base / height
    return force, who.mass_kg * (math.hypot(base, height) - height)
