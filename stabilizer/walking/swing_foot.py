"""The swing foot over the ground it is expected to meet."""

from __future__ import annotations

import math

import numpy as np

from surefoot.schemas.arrays import Mat, Vec3
from surefoot.schemas.walk_settings import WalkSettings
from surefoot.stabilizer.dynamics import SOLE_ROWS, Dynamics
from surefoot.stabilizer.model import yaw_from
from surefoot.stabilizer.walking.step_queue import Move
from surefoot.stabilizer.walking.swing import SwingPath, SwingReference, SwingTask

_UP = np.array([0.0, 0.0, 1.0])
STEEPEST = 0.3
"""No ground is expected to slope by more than this [rad]."""


class ExpectedGround:
    """Normal and motion of the ground: a plane through the standing sole.

    With both feet down the normal is the mean of the soles', as far as these agree
    with each other and with the line between them: a platform is followed, stones
    that each lie as they please count as level. With one foot down it turns with the
    ground under that foot, as the wrench law feeds it forward: not with the sole
    itself, since a sole that tips over its edge is no ground.

    Attributes:
        normal: (3,) unit, world.
        velocity: vertical speed at the swing foot [m/s].
        turn: (3,) angular velocity, about the level axes only [rad/s].
    """

    def __init__(self, settings: WalkSettings, *, period_s: float) -> None:
        """Begin level and at rest."""
        self._dt = period_s
        self._blend = -math.expm1(-period_s / settings.normal_filter_s)
        self._agreement = settings.normal_agreement
        self.normal: Vec3 = _UP.copy()
        self.velocity = 0.0
        self.turn: Vec3 = np.zeros(3)

    def from_both(self, dynamics: Dynamics) -> None:
        """Look at both soles, which stand."""
        left, right = (R[:, 2] for R in dynamics.R_world_sole)
        mean = left + right
        mean /= math.sqrt(mean @ mean)
        line = dynamics.p_sole[1] - dynamics.p_sole[0]
        apart = left - right
        slope = (line @ mean) / max(math.sqrt(line @ line), 1e-3)
        trust = math.exp(-(apart @ apart + slope * slope) / self._agreement**2)
        self.normal += self._blend * (_UP + trust * (mean - _UP) - self.normal)
        self._normalise()
        self.velocity = 0.0
        self.turn[:] = 0.0

    def from_one(self, dynamics: Dynamics, fed: Vec3, *, support: int) -> None:
        """Go on with the ground under one sole.

        Args:
            dynamics: quantities at the present state.
            fed: (12,) sole twists that are the ground's, sole frames.
            support: the foot that stands.
        """
        R = dynamics.R_world_sole[support]
        twist = fed[SOLE_ROWS[support]]
        turn = self.turn
        turn[:] = R @ twist[3:]
        turn[2] = 0.0
        across = dynamics.p_sole[1 - support] - dynamics.p_sole[support]
        vertical = R[2] @ twist[:3]
        self.velocity = float(vertical + turn[0] * across[1] - turn[1] * across[0])
        self.normal += self._dt * np.cross(turn, self.normal)
        self._normalise()

    def slope(self) -> tuple[float, float]:
        """Return how the plane rises ahead and to the left [1]."""
        x, y, z = self.normal.tolist()
        return -x / z, -y / z

    def _normalise(self) -> None:
        x, y, z = self.normal.tolist()
        level = math.hypot(x, y)
        if level > STEEPEST:
            x, y = x * STEEPEST / level, y * STEEPEST / level
            z = 1.0
        length = math.sqrt(x * x + y * y + z * z)
        self.normal[:] = x / length, y / length, z / length


class SwingFoot:
    """Writes where a foot in the air should be, in the world.

    Attributes:
        ground: that it is expected to meet.
        tasks: of left and right foot, for both QPs.
    """

    def __init__(
        self, settings: WalkSettings, *, lead_s: float, period_s: float
    ) -> None:
        """Wait for a step.

        Args:
            settings: of walking.
            lead_s: by which the velocity is ahead: the lag of the servos [s].
            period_s: time between two updates [s].
        """
        self._settings, self._lead_s, self._dt = settings, lead_s, period_s
        self.ground = ExpectedGround(settings, period_s=period_s)
        self._path = SwingPath(settings)
        self._references = (SwingReference(), SwingReference())
        self.tasks = [
            SwingTask(side, reference, settings)
            for side, reference in enumerate(self._references)
        ]

    @property
    def yaw(self) -> float:
        """Heading of the path [rad]."""
        return self._path.yaw

    def lift(self, move: Move, dynamics: Dynamics, *, rise: float) -> None:
        """Begin a step.

        Args:
            move: the step.
            dynamics: quantities at the present state.
            rise: of the foothold over the other foot's [m].
        """
        side = move.side
        p = dynamics.p_sole[side]
        slope_x, slope_y = self.ground.slope()
        across = p - dynamics.p_sole[1 - side]
        level = slope_x * across[0] + slope_y * across[1]
        self._path.begin(
            xy=(float(p[0]), float(p[1])),
            yaw=yaw_from(dynamics.R_world_sole[side], 0.0),
            height=float(across[2] - level),
            target=(move.place.x, move.place.y),
            target_yaw=move.place.yaw,
            rise=rise,
            lift=move.height_m,
            duration_s=move.single_s,
        )

    def go_on(
        self, side: int, dynamics: Dynamics, *, t: float, shift: tuple[float, float]
    ) -> None:
        """Follow the path.

        Args:
            side: the foot.
            dynamics: quantities at the present state.
            t: since lift-off [s].
            shift: of its goal, by step adjustment [m].
        """
        path, ground, reference = self._path, self.ground, self._references[side]
        support = dynamics.p_sole[1 - side]
        slope_x, slope_y = ground.slope()
        path.advance(t, shift=shift, dt=self._dt)
        x, y = path.xy
        across_x, across_y = x - support[0], y - support[1]
        level = support[2] + slope_x * across_x + slope_y * across_y
        reference.p[:] = x, y, level + path.height
        v_x, v_y = path.xy_rate
        along = slope_x * v_x + slope_y * v_y
        reference.v[:] = v_x, v_y, path.height_rate + along + ground.velocity
        reference.a[:] = *path.xy_acceleration, path.height_acceleration
        v_x, v_y, v_z = path.velocity_at(t + self._lead_s)
        along = slope_x * v_x + slope_y * v_y
        reference.v_ahead[:] = v_x, v_y, v_z + along + ground.velocity
        self._turn(reference)

    def go_down(
        self, side: int, dynamics: Dynamics, *, xy: tuple[float, float], yaw: float
    ) -> None:
        """Go straight down where the foot bounced.

        Args:
            side: the foot.
            dynamics: quantities at the present state.
            xy: where it is to stay [m].
            yaw: with which heading [rad].
        """
        reference = self._references[side]
        self._path.stay(xy, yaw)
        reference.p[:] = *xy, dynamics.p_sole[side][2]
        reference.v[:] = 0.0, 0.0, self.ground.velocity - self._settings.late_m_s
        reference.v_ahead[:] = reference.v
        reference.a[:] = 0.0
        self._turn(reference)

    def _turn(self, reference: SwingReference) -> None:
        """Write orientation and turn: along the ground, at the path's heading."""
        reference.w[:] = self.ground.turn
        reference.w[2] += self._path.yaw_rate
        _face(self.ground.normal, self._path.yaw, out=reference.R)


def _face(normal: Vec3, yaw: float, *, out: Mat) -> None:
    """Write the rotation with z along a normal and x ahead at a heading."""
    x, y, z = normal.tolist()
    cos, sin = math.cos(yaw), math.sin(yaw)
    # x axis: level heading, raised until it lies in the plane.
    up = -(x * cos + y * sin) / z
    length = math.sqrt(1.0 + up * up)
    a = (cos / length, sin / length, up / length)
    out[:, 0] = a
    out[:, 1] = y * a[2] - z * a[1], z * a[0] - x * a[2], x * a[1] - y * a[0]
    out[:, 2] = x, y, z
