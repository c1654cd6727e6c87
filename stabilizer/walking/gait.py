"""Phases of a walk, and the references of ZMP, DCM and CoM through them.

    stand -> shift -> [single -> double]* -> settle -> stand

One clock runs in each phase. The walk, which knows the feet, ends phases. This module
computes what follows for ZMP, DCM and centre of mass.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum

from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.dynamics import SolesAndCom
from surefoot.stabilizer.estimation.contact import Anchors
from surefoot.stabilizer.estimation.observer import ObservedState
from surefoot.stabilizer.walking.dcm import (
    Point,
    ZmpPhase,
    dcm_now,
    end_of_support,
    shift_between,
)
from surefoot.stabilizer.walking.footsteps import Foothold
from surefoot.stabilizer.walking.step_queue import Move

EVERY_TICKS = 4
"""Ticks between two computations of the DCM reference; between, it follows its law."""

AT_REST_M = 0.001
"""Distance to its place at which the centre of mass has come to rest [m]."""
STAIRS_RISE_SHARE = 0.625
"""Part of the CoM's possible rise over nominal that planned stairs may use [1]."""
DEEPEST_KEPT_S = 6.0
"""Time constant with which a deep place of the ground is forgotten [s]."""


class Phase(StrEnum):
    """Phases of a walk."""

    STAND = "stand"
    SHIFT = "shift"
    """The weight goes onto the first support."""
    SINGLE = "single"
    DOUBLE = "double"
    SETTLE = "settle"
    """The weight goes back between the feet."""


class Gait:
    """References of ZMP, DCM and centre of mass, odometry frame.

    Attributes:
        phase: the present one.
        t: time in the phase [s].
        duration_s: wanted duration of the phase; step adjustment may change it [s].
        support: foot that is to carry: alone in single support, more and more in double
            support.
        zmp: desired ZMP [m].
        dcm: reference of the DCM [m].
        com: reference of the centre of mass [m].
        com_velocity: its velocity [m/s].
        com_acceleration: its acceleration [m/s^2].
        omega: of the pendulum [1/s].
    """

    def __init__(
        self,
        settings: WalkSettings,
        *,
        omega: float,
        com_offset: Point,
        period_s: float,
    ) -> None:
        """Begin standing.

        Args:
            settings: times.
            omega: of the pendulum [1/s].
            com_offset: centre of mass of the nominal stance, from the middle of the
                soles, ahead and to the left [m].
            period_s: time between two updates [s].
        """
        self._settings = settings
        self._offset = com_offset
        self._dt = period_s
        self.omega = omega
        self.phase = Phase.STAND
        self.t = self.duration_s = self._double_s = 0.0
        self.support = 0
        self.zmp: Point = com_offset
        self.dcm: Point = com_offset
        self.com: Point = com_offset
        self.com_velocity: Point = (0.0, 0.0)
        self.com_acceleration: Point = (0.0, 0.0)
        self._from: Point = com_offset
        self._halfway: Point = com_offset
        self._ticks = 0

    @property
    def left_s(self) -> float:
        """Time left in the phase; 0 while it waits [s]."""
        return max(0.0, self.duration_s - self.t)

    def begin_shift(
        self,
        support: int,
        feet: Sequence[Foothold],
        moves: Sequence[Move],
        *,
        com: Point,
    ) -> None:
        """Begin to walk: the weight goes onto the first support.

        Args:
            support: foot of the first support.
            feet: places of both feet.
            moves: the steps to come.
            com: reference of the centre of mass, at rest [m].
        """
        self._enter(Phase.SHIFT, self._settings.shift_s)
        self.support = support
        self._from = self.zmp = self.dcm = self.com = com
        phases, xi_end = self._walk_on(feet, moves)
        self._halfway = shift_between(
            com,
            com,
            self.point(feet[support]),
            dcm_now(phases, xi_end, self.omega),
            duration_s=self.duration_s,
            omega=self.omega,
        )

    def begin_single(self, move: Move) -> None:
        """Begin single support; ``support`` carries already."""
        self._enter(Phase.SINGLE, move.single_s)
        self._double_s = move.double_s

    def begin_double(self) -> None:
        """Begin double support: the weight goes onto the landed foot."""
        self._enter(Phase.DOUBLE, self._double_s)
        self._from, self.support = self.zmp, 1 - self.support

    def begin_settle(self) -> None:
        """The weight goes back between the feet."""
        self._enter(Phase.SETTLE, self._settings.settle_s)
        self._from = self.zmp

    def stand(self) -> None:
        """End the walk."""
        self._enter(Phase.STAND, 0.0)

    def advance(
        self,
        feet: Sequence[Foothold],
        moves: Sequence[Move],
        *,
        pause_at: Point | None = None,
    ) -> None:
        """Advance by one tick.

        Args:
            feet: places of left and right foot, or where they are being set.
            moves: the steps to come after the present one.
            pause_at: where the ZMP stays for now while the clock stands still; the
                weight goes onto the other foot from there [m].
        """
        dt, omega = self._dt, self.omega
        if pause_at is None:
            self.t += dt
            self.zmp = self._wanted_zmp(feet)
        else:
            self.t, self._from, self.zmp = 0.0, pause_at, pause_at
        if self._ticks % EVERY_TICKS == 0:
            self.dcm = dcm_now(*self._ahead(feet, moves), omega)
        elif self.left_s > 0.0 or self.phase is Phase.SETTLE:
            self.dcm = (
                self.dcm[0] + dt * omega * (self.dcm[0] - self.zmp[0]),
                self.dcm[1] + dt * omega * (self.dcm[1] - self.zmp[1]),
            )
        self._ticks += 1
        (x, y), (xi_x, xi_y), (p_x, p_y) = self.com, self.dcm, self.zmp
        v_x, v_y = omega * (xi_x - x), omega * (xi_y - y)
        self.com = (x + dt * v_x, y + dt * v_y)
        self.com_velocity = (v_x, v_y)
        square = omega * omega
        self.com_acceleration = (square * (x - p_x), square * (y - p_y))

    def middle(self, feet: Sequence[Foothold]) -> Point:
        """Return the place of the centre of mass for standing on these feet [m]."""
        left, right = self.point(feet[0]), self.point(feet[1])
        return 0.5 * (left[0] + right[0]), 0.5 * (left[1] + right[1])

    def rests(self, feet: Sequence[Foothold]) -> bool:
        """Return whether the centre of mass has come to rest between the feet."""
        x, y = self.middle(feet)
        return math.hypot(self.com[0] - x, self.com[1] - y) < AT_REST_M

    def left_share(self, feet: Sequence[Foothold]) -> float:
        """Return the left foot's part of the weight for the desired ZMP [1]."""
        if self.phase is Phase.SINGLE:
            return 1.0 - self.support
        left, right = self.point(feet[0]), self.point(feet[1])
        x, y = left[0] - right[0], left[1] - right[1]
        along = (self.zmp[0] - right[0]) * x + (self.zmp[1] - right[1]) * y
        return min(max(along / max(x * x + y * y, 1e-6), 0.0), 1.0)

    def _enter(self, phase: Phase, duration_s: float) -> None:
        self.phase, self.t, self.duration_s = phase, 0.0, duration_s
        self._ticks = 0

    def point(self, foot: Foothold) -> Point:
        """Return the place of the ZMP while a foot carries alone [m]."""
        x, y = self._offset
        cos, sin = math.cos(foot.yaw), math.sin(foot.yaw)
        return foot.x + cos * x - sin * y, foot.y + sin * x + cos * y

    def _wanted_zmp(self, feet: Sequence[Foothold]) -> Point:
        phase = self.phase
        if phase is Phase.STAND:
            return self.middle(feet)
        to = self.point(feet[self.support])
        if phase is Phase.SINGLE:
            return to
        done = min(self.t / self.duration_s, 1.0)
        if phase is Phase.SHIFT:
            if done < 0.5:
                return _between(self._from, self._halfway, 2.0 * done)
            return _between(self._halfway, to, 2.0 * done - 1.0)
        if phase is Phase.SETTLE:
            to = self.middle(feet)
        return _between(self._from, to, done)

    def _ahead(
        self, feet: Sequence[Foothold], moves: Sequence[Move]
    ) -> tuple[list[ZmpPhase], Point]:
        """Return the desired ZMP from now on, and the DCM at its end."""
        phase, left_s = self.phase, self.left_s
        if phase in (Phase.STAND, Phase.SETTLE):
            middle = self.middle(feet)
            return [ZmpPhase(left_s, self.zmp, middle)], middle
        here = self.point(feet[self.support])
        half_s = 0.5 * self.duration_s
        if phase is Phase.SHIFT and left_s > half_s:
            now = [
                ZmpPhase(left_s - half_s, self.zmp, self._halfway),
                ZmpPhase(half_s, self._halfway, here),
            ]
        else:
            now = [ZmpPhase(left_s, self.zmp, here)]
        after, xi_end = self._walk_on(feet, moves)
        return now + after, xi_end

    def _walk_on(
        self, feet: Sequence[Foothold], moves: Sequence[Move]
    ) -> tuple[list[ZmpPhase], Point]:
        """Return the same for what follows the present phase."""
        here, places = self.point(feet[self.support]), list(feet)
        phases: list[ZmpPhase] = []
        if self.phase is Phase.SINGLE and moves:
            there = self.point(feet[1 - self.support])
            phases.append(ZmpPhase(self._double_s, here, there))
            here = there
        for number, move in enumerate(moves):
            there = self.point(move.place)
            places[move.side] = move.place
            if number == self._settings.preview_steps:
                return phases, end_of_support(
                    here,
                    there,
                    single_s=move.single_s,
                    double_s=move.double_s,
                    omega=self.omega,
                )
            phases.append(ZmpPhase(move.single_s, here, here))
            if number < len(moves) - 1:
                phases.append(ZmpPhase(move.double_s, here, there))
                here = there
        middle = self.middle(places)
        phases.append(ZmpPhase(self._settings.settle_s, here, middle))
        return phases, middle


class HeightReference:
    """Reference of the CoM's height: over the ground, with its deepest place in reach.

    Planned stairs are climbed on time, by a filter of third order. The ground's
    difference from its plan is followed slowly. After a walk a robot may stand far from
    the axis about which its ground turns. The ground under it then sinks deeper, and a
    leg that is straight by then cannot follow.
    """

    def __init__(
        self, settings: WalkSettings, *, com_rise: float, period_s: float
    ) -> None:
        """Begin on level ground.

        Args:
            settings: time constants.
            com_rise: largest height of the centre of mass over the soles, from nominal
                [m].
            period_s: time between two updates [s].
        """
        self._dt, self._climb_rate = period_s, 1.0 / settings.climb_s
        self._stairs_rise = STAIRS_RISE_SHARE * com_rise
        self._blend = period_s / settings.height_s
        self._forget = period_s / DEEPEST_KEPT_S
        self._deepest = 0.0
        self._planned = [0.0, 0.0, 0.0]

    def follow(
        self,
        stance: Stance,
        state: ObservedState,
        soles: SolesAndCom,
        anchors: Anchors,
        *,
        under: int | None,
        middle_over_support: float,
    ) -> None:
        """Advance by one tick.

        Args:
            stance: gets the height, with its planned velocity and acceleration.
            state: has the height of the carrying ground.
            soles: at the present state.
            anchors: has the planned heights of the footholds.
            under: the foot in the air or landing, whose ground the other one shows.
            middle_over_support: height of the middle between the feet over the
                standing one [m].
        """
        level_left, level_right = anchors.level
        carries = state.ground_height - anchors.carrying
        middle = carries + middle_over_support
        if under is None:
            left, right = soles.p_sole
            apart = (left.item(2) - level_left) - (right.item(2) - level_right)
            low, lowest = middle - 0.5 * abs(apart), min(level_left, level_right)
        else:
            low = min(carries, carries + 2.0 * middle_over_support)
            lowest = anchors.level[1 - under]
        self._deepest = min(low, self._deepest + self._forget * (low - self._deepest))
        planned = self._planned
        stance.com_height -= planned[0]
        stance.approach_ground(middle, highest=self._deepest, share=self._blend)
        self._climb(min(0.5 * (level_left + level_right), lowest + self._stairs_rise))
        stance.com_height += planned[0]
        stance.com_velocity[2], stance.com_acceleration[2] = planned[1:]

    def _climb(self, to: float) -> None:
        """Approach a planned height, with its velocity and acceleration."""
        place, velocity, acceleration = self._planned
        rate = self._climb_rate
        jerk = rate * (
            rate * (rate * (to - place) - 3.0 * velocity) - 3.0 * acceleration
        )
        acceleration += self._dt * jerk
        velocity += self._dt * acceleration
        self._planned[:] = place + self._dt * velocity, velocity, acceleration


def _between(a: Point, b: Point, share: float) -> Point:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
