"""Reference of centre of mass, base, posture and feet, followed by both QPs.

Without a planner it is the standing stance: nominal posture, centre of mass over the
middle of the feet, base upright. A planner's :class:`Reference` message replaces it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.messages import Reference
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import RobotModel, yaw_from

NEAR_M, NEAR_RAD = 0.02, 0.05
"""Largest distance from its reference at which a robot is asked for it at once."""
APPROACH_RAD_S = 3.5
"""Rate at which it is led there otherwise: 97 % in 2 s."""
ARRIVED = 1e-4
"""Rest of the way, in metres or radians, that counts as arrived."""
BEYOND_SOLES_M = 0.1
"""No centre of mass can be kept farther from the soles, moving or not [m]."""
FASTEST_M_S, HARDEST_M_S2 = 3.0, 15.0
"""More than a robot on its feet can be asked for; friction alone bears less."""
FARTHEST_FOOT_M = 1.0
"""From the middle between the feet to either foot [m]."""
BEYOND_RANGE_RAD = 0.01
"""A planner may round the end of a joint's range by this [rad]."""
NORMS = (0.9, 1.1)
"""Norm of a quaternion that counts as an attitude."""


@dataclass
class Stance:
    """Where centre of mass, base, joints and feet should be, in the stance frame.

    This is the controller's own copy of the reference, in its units and joint order.
    Its arrays are written in place.

    Attributes:
        com: (3,) centre of mass [m]; z is kept within reach of the legs.
        com_height: height of the centre of mass before that limit [m].
        com_velocity: (3,) [m/s].
        com_acceleration: (3,) [m/s^2].
        ground_acceleration: (3,) acceleration of the ground that the robot follows
            [m/s^2].
        R_base: (3, 3) base rotation.
        posture: (n_a,) joints in model order [rad].
        p_sole: positions of left and right sole [m].
        yaw_sole: yaw of left and right sole [rad].
        base_error: (3,) rotation from base to reference, base axes [rad].
        com_nominal: height of the centre of mass in the nominal stance [m].
        load: planned part of the weight on left and right foot while both stand [1].
    """

    com: Vec3
    com_height: float
    com_velocity: Vec3
    com_acceleration: Vec3
    ground_acceleration: Vec3
    R_base: Mat
    posture: Array
    p_sole: list[Vec3]
    yaw_sole: list[float]
    com_nominal: float
    base_error: Vec3
    load: list[float]
    _followed: Reference | None = None

    def compare_base(self, R_world_base: Mat) -> None:
        """Update ``base_error``, the rotation vector from base to reference.

        Args:
            R_world_base: (3, 3) estimated base rotation.
        """
        self.base_error[:] = pin.log3(R_world_base.T.dot(self.R_base))

    def follow(self, reference: Reference | None, model: RobotModel) -> None:
        """Take over a planner's reference, joints in bus order, if it is new."""
        if reference is not None and reference is not self._followed:
            self._followed = reference
            self._set(reference, model)

    def _set(self, reference: Reference, model: RobotModel) -> None:
        self.com[:] = reference.com
        self.com_height = reference.com[2]
        self.com_velocity[:] = reference.com_velocity
        self.com_acceleration[:] = reference.com_acceleration
        quaternion = pin.Quaternion(np.array(reference.base_quat_xyzw))
        quaternion.normalize()
        self.R_base[:] = quaternion.toRotationMatrix()
        self.posture[:] = np.array(reference.posture)[model.to_model]
        for side, foot in enumerate(reference.feet[:2]):
            self.p_sole[side][:] = foot.position
            x, y, z, w = foot.quat_xyzw
            self.yaw_sole[side] = float(
                np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
            )

    def approach_ground(self, ground: float, *, highest: float, share: float) -> None:
        """Let the height follow the ground that a walk has reached.

        Args:
            ground: present height of the soles against nominal [m].
            highest: height against nominal that must stay in reach [m].
            share: part of the way to go in this tick [1].
        """
        wanted = self.com_nominal + min(ground, highest)
        self.com_height += share * (wanted - self.com_height)

    def limit_height(self, ground: float, *, travel: tuple[float, float]) -> None:
        """Keep the height reference within reach of the legs.

        A straight or fully folded leg cannot follow its ground.

        Args:
            ground: present height of the soles against nominal [m].
            travel: lowest and highest reference over the soles, from nominal [m].
        """
        lowest, highest = travel
        level = self.com_nominal + ground
        self.com[2] = min(max(self.com_height, level + lowest), level + highest)


class Approach:
    """The way from the state at the start to the reference.

    A robot that was held while its ground turned leans, and its CoM is too far off for
    a step of the reference: the foot to be unloaded would lift. So the reference begins
    at the present place and speed, with no acceleration, and goes to its own place
    through a filter of third order. A robot within a margin of its reference is asked
    for it at once.
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin with nothing to do; see :meth:`begin`."""
        self._dt = period_s
        self._offset, self._rate = np.zeros(6), np.zeros(6)
        self._acceleration = np.zeros(6)
        self.is_over = True

    def begin(self, dynamics: Dynamics, stance: Stance) -> None:
        """Start from the present state."""
        offset, rate = self._offset, self._rate
        np.subtract(dynamics.p_com, stance.com, out=offset[:3])
        np.negative(stance.base_error, out=offset[3:])
        np.subtract(dynamics.v_com, stance.com_velocity, out=rate[:3])
        rate[3:] = dynamics.v[3:6]
        self._acceleration[:] = 0.0
        for part, margin in ((slice(0, 3), NEAR_M), (slice(3, 6), NEAR_RAD)):
            size = math.sqrt(offset[part] @ offset[part])
            share = 0.0 if size <= margin else 1.0 - margin / size
            offset[part] *= share
            rate[part] *= share
        self.is_over = not offset.any()

    def step(self) -> None:
        """Advance by a tick."""
        p, dt = APPROACH_RAD_S, self._dt
        offset, rate, acceleration = self._offset, self._rate, self._acceleration
        jerk = 3.0 * p * acceleration + 3.0 * p * p * rate + p**3 * offset
        offset += dt * rate
        rate += dt * acceleration
        acceleration -= dt * jerk
        self.is_over = bool(np.abs(offset).max() < ARRIVED)

    def move(self, stance: Stance, way: float) -> None:
        """Add the present offset to the reference, or take it off again.

        Args:
            stance: the reference, changed in place; its base error is updated.
            way: 1 to add the offset, -1 to take it off.
        """
        stance.com += way * self._offset[:3]
        stance.com_velocity += way * self._rate[:3]
        stance.com_acceleration += way * self._acceleration[:3]
        stance.base_error += way * self._offset[3:]


class ReferenceLimits:
    """What a robot on both feet can be asked for; what is beyond throws it over.

    Generous: what is refused is another unit, another frame or a planner gone wrong.
    """

    def __init__(self, model: RobotModel) -> None:
        """Read the limits of a robot."""
        self._names = model.robot.joint_names
        self._lower = model.robot.lower - BEYOND_RANGE_RAD
        self._upper = model.robot.upper + BEYOND_RANGE_RAD
        self._soles = [p.tolist() for p in standing(model).p_sole]
        self._reach = [
            max(sizes) + BEYOND_SOLES_M for sizes in zip(*model.half_sizes, strict=True)
        ]

    def why_not(self, reference: Reference) -> str:
        """Why it cannot be followed, in words; empty when it can."""
        turns = [reference.base_quat_xyzw, *(f.quat_xyzw for f in reference.feet)]
        for quaternion in turns:
            norm = math.hypot(*quaternion)
            if not NORMS[0] < norm < NORMS[1]:
                return f"a quaternion of norm {norm:.3g}, expected 1 (x y z w)"
        posture = np.array(reference.posture)
        beyond = np.maximum(self._lower - posture, posture - self._upper)
        worst = int(beyond.argmax())
        if beyond[worst] > 0.0:
            return (
                f"{self._names[worst]} at {posture[worst]:.4g} rad, expected "
                f"{self._lower[worst]:.3f} to {self._upper[worst]:.3f}"
            )
        feet = [foot.position for foot in reference.feet] or self._soles
        return (
            _beyond("foot position", max(feet, key=_size), FARTHEST_FOOT_M, "m")
            or _beyond("com_velocity", reference.com_velocity, FASTEST_M_S, "m/s")
            or _beyond(
                "com_acceleration", reference.com_acceleration, HARDEST_M_S2, "m/s^2"
            )
            or self._off_the_soles(reference.com, feet)
        )

    def _off_the_soles(self, com: list[float], feet: list[list[float]]) -> str:
        for axis, reach in enumerate(self._reach):
            ends = [foot[axis] for foot in feet]
            least, most = min(ends) - reach, max(ends) + reach
            if not least <= com[axis] <= most:
                return (
                    f"com {'xy'[axis]} at {com[axis]:.3g} m, expected {least:.3f} to "
                    f"{most:.3f} m from between the feet"
                )
        return ""


def _size(vector: list[float]) -> float:
    return max(map(abs, vector))


def _beyond(name: str, vector: list[float], most: float, unit: str) -> str:
    size = _size(vector)
    return f"{name}: {size:.3g} {unit}, at most {most:g}" if size > most else ""


def standing(model: RobotModel) -> Stance:
    """Return the nominal posture on level ground, base upright."""
    q = model.nominal_configuration()
    data = model.pin_model.createData()
    com = pin.centerOfMass(model.pin_model, data, q).copy()
    pin.updateFramePlacements(model.pin_model, data)
    return Stance(
        com=com,
        com_height=float(com[2]),
        com_velocity=np.zeros(3),
        com_acceleration=np.zeros(3),
        ground_acceleration=np.zeros(3),
        R_base=np.eye(3),
        posture=model.nominal.copy(),
        p_sole=[data.oMf[i].translation.copy() for i in model.sole_ids],
        yaw_sole=[yaw_from(data.oMf[i].rotation, 0.0) for i in model.sole_ids],
        com_nominal=float(com[2]),
        base_error=np.zeros(3),
        load=[0.5, 0.5],
    )
