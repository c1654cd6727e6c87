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
