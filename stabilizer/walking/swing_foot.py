"""Swing foot over the expected ground: from its path to references in the world."""

from __future__ import annotations

import math
from dataclasses import replace

from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.dynamics import SolesAndCom
from surefoot.stabilizer.model import yaw_from
from surefoot.stabilizer.walking.footsteps import Foothold, LegSpeed, swing_time
from surefoot.stabilizer.walking.ground import ExpectedGround
from surefoot.stabilizer.walking.step_queue import Move
from surefoot.stabilizer.walking.swing import (
    SwingPath,
    SwingReference,
    SwingTask,
    late_descent,
)

CAUGHT_S = 0.003
"""Least time for which a force must last to be an edge's [s]."""
BACK_M = 0.01
"""Distance by which a caught foot goes back before it rises."""
FREE_S = 0.1
"""Time that it has to come free."""


class SwingFoot:
    """Writes the reference of a foot in the air, in the world.

    Attributes:
        references: references of left and right foot while in the air.
        tasks: tasks of left and right foot; accelerations for the first QP, twists for
            the second.
    """

    def __init__(
        self,
        settings: WalkSettings,
        ground: ExpectedGround,
        *,
        lead_s: float,
        leg_speed: LegSpeed,
        weight: float,
        period_s: float,
    ) -> None:
        """Wait for a step.

        Args:
            settings: of walking.
            ground: expected ground; read, not advanced.
            lead_s: lead of the velocity: the lag of the servos [s].
            leg_speed: of the slower leg.
            weight: of the robot [N].
            period_s: time between two updates [s].
        """
        self._settings, self._lead_s, self._dt = settings, lead_s, period_s
        self._most = settings.caught_share * weight
        self._leg_speed = leg_speed
        self._ground = ground
        self._path = SwingPath(settings)
        self._caught_s = self._begun_s = 0.0
        self.references = (SwingReference(), SwingReference())
        self.tasks = [
            SwingTask(side, reference, settings)
            for side, reference in enumerate(self.references)
        ]

    @property
    def yaw(self) -> float:
        """Heading of the path [rad]."""
        return self._path.yaw

    @property
    def on_its_way(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Place of the foot on its path, and the place without the shift [m]."""
        return self._path.xy, self._path.unshifted

    def least_left_s(self, move: Move, shift: tuple[float, float]) -> float:
        """Return the least time that the foot needs to get to its place [s].

        Args:
            move: the step, as planned.
            shift: of its goal, by step adjustment [m].
        """
        path, place = self._path, move.place
        start_x, start_y = path.start
        least_s = swing_time(
            math.hypot(place.x + shift[0] - start_x, place.y + shift[1] - start_y),
            self._settings,
            leg_speed=self._leg_speed,
            lift=move.height_m,
            turn=path.turn,
        )
        return least_s * (1.0 - path.time / path.duration_s)

    def lift(
        self, move: Move, soles: SolesAndCom, *, rise: float, climb: float
    ) -> None:
        """Begin a step.

        Args:
            move: the step.
            soles: at the present state.
            rise: of the foothold over the other foot's [m].
            climb: height of the foothold over the one that is left, by plan [m].
        """
        side = move.side
        p = soles.p_sole[side]
        self._caught_s = self._begun_s = 0.0
        self._path.begin(
            xy=(float(p[0]), float(p[1])),
            yaw=yaw_from(soles.R_world_sole[side], 0.0),
            height=self._height_of(side, soles),
            target=(move.place.x, move.place.y),
            target_yaw=move.place.yaw,
            rise=rise,
            lift=move.height_m,
            duration_s=move.single_s,
            climb=climb,
        )

    def is_caught(self, side: int, soles: SolesAndCom, F: Array) -> bool:
        """Return whether an edge keeps the foot from going on.

        Ground below pushes back by friction, less than it pushes up. A force that
        pushes back more comes from something in the way.

        Args:
            side: the foot.
            soles: at the present state.
            F: (6,) measured wrench of the foot, sole frame [N, N m].
        """
        path = self._path
        if not self._settings.step_over_m or (self._begun_s and path.time < FREE_S):
            return False
        x, y, up = soles.R_world_sole[side].dot(F[:3]).tolist()
        way_x, way_y = path.way
        back = -(x * way_x + y * way_y)
        meets = back > max(self._most, up)
        self._caught_s = self._caught_s + self._dt if meets else 0.0
        return self._caught_s > max(CAUGHT_S, self._dt) - 0.5 * self._dt

    def step_over(
        self, move: Move, soles: SolesAndCom, *, t: float, left_s: float, rise: float
    ) -> tuple[Move, float]:
        """Restart the path from where the foot is caught: back, higher, and on.

        Args:
            move: the step.
            soles: at the present state.
            t: since lift-off [s].
            left_s: time until the planned touchdown [s].
            rise: of the foothold over the other foot's [m].

        Returns:
            The step, and the time that the foot needs from now on, at least the time
            left [s]. If the obstacle is higher than steps may be, the step instead ends
            where the foot is.
        """
        path, side, higher = self._path, move.side, self._settings.step_over_m
        x, y, _ = soles.p_sole[side].tolist()
        x, y = x - BACK_M * path.way[0], y - BACK_M * path.way[1]
        if path.apex + higher > self._settings.rise_limit_m:
            higher, place = 0.0, move.place
            move = replace(move, place=Foothold(x, y, place.z, path.yaw))
        height = self._height_of(side, soles)
        lift = max(path.apex - max(height, rise), 0.0) + higher
        least_s = swing_time(
            math.hypot(move.place.x - x, move.place.y - y),
            self._settings,
            leg_speed=self._leg_speed,
            lift=lift,
            climb=higher,
            turn=math.remainder(move.place.yaw - path.yaw, math.tau),
        )
        duration_s = max(left_s, least_s, move.single_s)
        self._caught_s, self._begun_s = 0.0, t
        path.begin(
            xy=(x, y),
            yaw=path.yaw,
            height=height,
            target=(move.place.x, move.place.y),
            target_yaw=move.place.yaw,
            rise=rise,
            lift=lift,
            duration_s=duration_s,
            climb=higher,
        )
        return move, duration_s

    def _height_of(self, side: int, soles: SolesAndCom) -> float:
        """Return the height of a sole over the other one's ground [m]."""
        slope_x, slope_y = self._ground.slope()
        across = soles.p_sole[side] - soles.p_sole[1 - side]
        level = slope_x * across[0] + slope_y * across[1]
        return float(across[2] - level)

    def go_on(
        self,
        side: int,
        soles: SolesAndCom,
        *,
        t: float,
        duration_s: float,
        shift: tuple[float, float],
    ) -> None:
        """Follow the path.

        Args:
            side: the foot.
            soles: at the present state.
            t: since lift-off [s].
            duration_s: time from lift-off to the touchdown wanted now [s].
            shift: of its goal, by step adjustment [m].
        """
        path, ground, reference = self._path, self._ground, self.references[side]
        support = soles.p_sole[1 - side].tolist()
        slope_x, slope_y = ground.slope()
        begun_s = self._begun_s
        path.advance(
            t - begun_s, duration_s=duration_s - begun_s, shift=shift, dt=self._dt
        )
        x, y = path.xy
        across_x, across_y = x - support[0], y - support[1]
        level = support[2] + slope_x * across_x + slope_y * across_y
        v_x, v_y = path.xy_rate
        along = slope_x * v_x + slope_y * v_y
        soon_x, soon_y, soon_z = path.velocity_after(self._lead_s)
        soon_along = slope_x * soon_x + slope_y * soon_y
        reference.write(
            *(x, y, level + path.height),
            *(v_x, v_y, path.height_rate + along + ground.velocity),
            *path.xy_acceleration,
            path.height_acceleration,
            *(soon_x, soon_y, soon_z + soon_along + ground.velocity),
            *self._turning(),
        )

    def go_down(
        self,
        side: int,
        soles: SolesAndCom,
        xy: tuple[float, float],
        *,
        yaw: float,
        since_s: float,
    ) -> None:
        """Go straight down where the foot bounced.

        Args:
            side: the foot.
            soles: at the present state.
            xy: place where it is to stay [m].
            yaw: its heading [rad].
            since_s: time since it bounced; infinite to hurry [s].
        """
        self._path.stay(xy, yaw)
        speed, _ = late_descent(since_s, self._settings)
        v = (0.0, 0.0, self._ground.velocity - speed)
        z = soles.p_sole[side].item(2)
        self.references[side].write(*xy, z, *v, 0.0, 0.0, 0.0, *v, *self._turning())

    def _turning(self) -> tuple[float, ...]:
        """Return w and R: along the ground, with the path's heading."""
        w_x, w_y, w_z = self._ground.turn.tolist()
        path = self._path
        facing = _facing(self._ground.normal, path.yaw)
        return w_x, w_y, w_z + path.yaw_rate, *facing


def _facing(normal: Vec3, yaw: float) -> tuple[float, ...]:
    """Return the rotation with z along a normal and x towards a heading, row by row."""
    x, y, z = normal.tolist()
    cos, sin = math.cos(yaw), math.sin(yaw)
    # x axis: the level heading, raised into the plane.
    up = -(x * cos + y * sin) / z
    length = math.sqrt(1.0 + up * up)
    a_x, a_y, a_z = cos / length, sin / length, up / length
    return (
        *(a_x, y * a_z - z * a_y, x),
        *(a_y, z * a_x - x * a_z, y),
        *(a_z, x * a_y - y * a_x, z),
    )
