"""Expected ground of a walk: its plane and motion, told from the standing sole."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.control.force_feedback import ForceFeedback
from surefoot.stabilizer.dynamics import (
    SOLE_ROWS,
    Dynamics,
    SolesAndCom,
    cross,
    part_between,
)
from surefoot.stabilizer.estimation.contact import Anchors
from surefoot.stabilizer.walking.feet import Feet, FootState

_UP = np.array([0.0, 0.0, 1.0])
EDGE = (0.98, 0.93)
"""Centre of pressure at which a sole tips, and from which it begins to tip [1]."""
LEAST_FORCE_N = 20.0
"""Normal force below which a centre of pressure is noise."""
PRESSED_N = 60.0
"""Normal force above which a sole lies on the ground, or on an edge."""
TURNS_KEPT_S = 2.0
"""Memory of how both soles turn, in time that both are pressed."""
STILL_RAD_S, STILL_S = 0.03, 0.1
"""Speed and duration of turns below which soles have not shown it [rad/s], [s]."""
TOGETHER = (0.4, 0.7)
"""Correlation of the soles' turns: up to the first each turns by itself, from the
second on the ground turns [1]."""
STEEPEST = 0.3
"""Largest slope of expected ground [rad]."""
RELIEF_M = 0.003
"""A foothold that seems less high over or under the other one is level with it [m]."""


class GroundMotion(Protocol):
    """Motion of the soles, and the part of it that is the ground's.

    Attributes:
        share: the ground's part of it, left and right foot [1].
        ground_twist: (12,) low-passed sole twists.
    """

    share: list[float]
    ground_twist: Array


class ExpectedGround:
    """Normal and motion of the ground: a plane through the standing sole.

    With both feet planted its normal is the mean of the soles' normals, as far as these
    agree with each other and with the line between the soles. A platform is followed;
    stones at random angles count as level.

    From when one foot leaves until it has landed, the ground turns with the other sole,
    as far as both soles have been seen to turn together. About an axis it does so only
    while the pressure is off the sole's edge. A sole that tips stands on that edge, or
    on an edge of a stone anywhere under it.

    Attributes:
        normal: (3,) unit, world.
        velocity: vertical speed at the swing foot [m/s].
        turn: (3,) angular velocity, about the level axes only [rad/s].
        under: the foot in the air or landing, whose ground the other one shows.
        middle_over_support: height of the middle between the feet over the standing
            one, while the other one shows no ground [m].
        edge_share: part of the sole's roll and pitch that is the ground's [1].
        turns: degree to which both soles have been seen to turn as one ground [1].
    """

    def __init__(
        self,
        settings: WalkSettings,
        *,
        half_sizes: Sequence[tuple[float, float]],
        period_s: float,
    ) -> None:
        """Begin level and at rest.

        Args:
            settings: filter and agreement.
            half_sizes: half length and half width of left and right sole [m].
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self._blend = -math.expm1(-period_s / settings.normal_filter_s)
        self._agreement = settings.normal_agreement
        self.normal: Vec3 = _UP.copy()
        self.velocity = 0.0
        self.turn: Vec3 = np.zeros(3)
        self.under: int | None = None
        self._off: int | None = None
        self.middle_over_support = 0.0
        self.edge_share = [1.0, 1.0]
        self._half_sizes = half_sizes
        self._in_sole: Vec3 = _UP.copy()
        self._scratch: Vec3 = np.zeros(3)
        self.turns = 0.0
        self._forget = period_s / TURNS_KEPT_S
        self._least_turn = STILL_RAD_S**2 * STILL_S / TURNS_KEPT_S
        self._turned_together = self._turned = 0.0

    def update(
        self, soles: SolesAndCom, law: GroundMotion, F_meas: Array, *, feet: Feet
    ) -> None:
        """Advance by one tick.

        Args:
            soles: at the present state.
            law: has the soles' motion, and the ground's part of it.
            F_meas: (12,) wrenches of the ground on the soles.
            feet: has the states of the feet.
        """
        self.under = feet.arriving
        off = self.under
        if off is None and FootState.LEAVING in feet.states:
            off = feet.states.index(FootState.LEAVING)
        are_pressed = min(F_meas.item(2), F_meas.item(8)) > PRESSED_N
        if are_pressed and self.under is None:
            self._compare_turns(soles, law)
        if off is None:
            self.from_both(soles)
        else:
            if self._off != off:
                self.stand_on(soles, support=1 - off)
            self.from_one(soles, law, F_meas, support=1 - off)
            if are_pressed:
                self._agree(soles, support=1 - off)
        self._off = off
        if self.under is None:
            self.middle_over_support = 0.0

    def find_relief(
        self, soles: SolesAndCom, F_meas: Array, anchors: Anchors, *, moved: int
    ) -> None:
        """Find how much higher than planned a foothold is than the other one.

        While both soles are pressed, the legs tell. Soles that turn as one ground, or
        lie in one plane within half the agreement, show the height of that plane.

        Args:
            soles: at the present state.
            F_meas: (12,) wrenches of the ground on the soles.
            anchors: gets the relief.
            moved: the foot that was set down last.
        """
        if min(F_meas.item(2), F_meas.item(8)) <= PRESSED_N:
            return
        support = 1 - moved
        mean, trust = self._common(soles)
        slope = max(self.turns, trust**4)
        n_x, n_y, n_z = (_UP + slope * (mean - _UP)).tolist()
        (x, y, z), (from_x, from_y, from_z) = (
            self._ground_at(side, soles, F_meas) for side in (moved, support)
        )
        rise = z - from_z + ((x - from_x) * n_x + (y - from_y) * n_y) / n_z
        rise -= anchors.level[moved] - anchors.level[support]
        if abs(rise) < RELIEF_M:
            rise = 0.0
        relief = anchors.relief
        relief[moved] += self._blend * (relief[support] + rise - relief[moved])

    def _ground_at(
        self, side: int, soles: SolesAndCom, F_meas: Array
    ) -> tuple[float, float, float]:
        """Return the place of the ground under a sole, world [m]: its middle.

        Of a tipping sole it is the pressed point, which alone stays on the ground.
        """
        x, y, roll_room, pitch_room = self._pressed(side, F_meas)
        x, y = x * (1.0 - pitch_room), y * (1.0 - roll_room)
        place, R = soles.p_sole[side].tolist(), soles.R_world_sole[side].tolist()
        p_x, p_y, p_z = (
            p + x * row[0] + y * row[1] for p, row in zip(place, R, strict=True)
        )
        return p_x, p_y, p_z

    def _pressed(self, side: int, F_meas: Array) -> tuple[float, float, float, float]:
        """Return a sole's centre of pressure, and its rooms about roll and pitch.

        Returns:
            x and y, sole frame [m]; 1 while the pressure is off the edges over which
            the sole would roll, and pitch, and 0 at these edges [1].
        """
        _, _, normal, m_x, m_y, _ = F_meas[SOLE_ROWS[side]].tolist()
        half_length, half_width = self._half_sizes[side]
        pressed = max(normal, LEAST_FORCE_N)
        x = min(max(-m_y / pressed, -half_length), half_length)
        y = min(max(m_x / pressed, -half_width), half_width)
        roll_room = part_between(abs(y) / half_width, *EDGE)
        pitch_room = part_between(abs(x) / half_length, *EDGE)
        return x, y, roll_room, pitch_room

    def carry(self, dynamics: Dynamics, law: ForceFeedback) -> None:
        """Make a landing foot move with its ground.

        Args:
            dynamics: quantities at the present state.
            law: has the twists of the soles, written in place.
        """
        if self.under is None:
            return
        R, rows = dynamics.R_world_sole[self.under], SOLE_ROWS[self.under]
        missing = 1.0 - law.share[self.under]
        twist = law.r[rows]
        twist[:3] += (missing * self.velocity) * R[2]
        twist[3:] += missing * (self.turn @ R)

    def from_both(self, soles: SolesAndCom) -> None:
        """Update the plane from both soles, which stand."""
        mean, trust = self._common(soles)
        w_left, w_right = soles.v_sole[3:6], soles.v_sole[9:12]
        turn = soles.R_world_sole[0] @ w_left + soles.R_world_sole[1] @ w_right
        self.normal += (0.5 * trust * self._dt) * cross(turn, self.normal)
        self.normal += self._blend * (_UP + trust * (mean - _UP) - self.normal)
        self._point(*self.normal.tolist())
        self.velocity = 0.0
        self.turn[:] = 0.0

    def _common(self, soles: SolesAndCom) -> tuple[Vec3, float]:
        """Return the soles' mean normal, and how well they fit one plane [1]."""
        left, right = (R[:, 2] for R in soles.R_world_sole)
        mean = left + right
        mean /= math.sqrt(mean @ mean)
        line = soles.p_sole[1] - soles.p_sole[0]
        apart = left - right
        slope = (line @ mean) / max(math.sqrt(line @ line), 1e-3)
        return mean, math.exp(-(apart @ apart + slope * slope) / self._agreement**2)

    def _compare_turns(self, soles: SolesAndCom, law: GroundMotion) -> None:
        """Compare the turns of both soles while they are pressed."""
        (l_x, l_y, _), (r_x, r_y, _) = (
            (R @ law.ground_twist[rows][3:]).tolist()
            for R, rows in zip(soles.R_world_sole, SOLE_ROWS, strict=True)
        )
        together = l_x * r_x + l_y * r_y
        each = 0.5 * (l_x * l_x + l_y * l_y + r_x * r_x + r_y * r_y)
        self._turned_together += self._forget * (together - self._turned_together)
        self._turned += self._forget * (each - self._turned)
        alike = self._turned_together / (self._turned + self._least_turn)
        self.turns = part_between(alike, *TOGETHER)

    def _agree(self, soles: SolesAndCom, *, support: int) -> None:
        """Update the plane from both pressed soles, as far as they agree.

        One sole pressed at its edge may tip; two do not tip into one plane.
        """
        mean, trust = self._common(soles)
        self.normal += (self._blend * trust) * (mean - self.normal)
        self._point(*self.normal.tolist())
        self._in_sole[:] = self.normal @ soles.R_world_sole[support]

    def stand_on(self, soles: SolesAndCom, *, support: int) -> None:
        """Begin to take the ground from one sole alone.

        Args:
            soles: at the present state.
            support: the foot that stands.
        """
        self._in_sole[:] = self.normal @ soles.R_world_sole[support]
        self.edge_share[:] = 1.0, 1.0

    def from_one(
        self,
        soles: SolesAndCom,
        law: GroundMotion,
        F_meas: Array,
        *,
        support: int,
    ) -> None:
        """Update the ground from one sole.

        Args:
            soles: at the present state.
            law: has the soles' motion, and the ground's part of it.
            F_meas: (12,) wrenches of the ground on the soles.
            support: the foot that stands.
        """
        R, blend = soles.R_world_sole[support], self._blend
        rows = SOLE_ROWS[support]
        share = law.share[support]
        v_x, v_y, v_z, w_x, w_y, _ = law.ground_twist[rows].tolist()
        v_x, v_y, v_z = share * v_x, share * v_y, share * v_z
        w_x, w_y = share * w_x, share * w_y
        x, y, roll_room, pitch_room = self._pressed(support, F_meas)
        shares = self.edge_share
        shares[0] += blend * (roll_room - shares[0])
        shares[1] += blend * (pitch_room - shares[1])
        turns = self.turns
        roll, pitch = turns * shares[0], turns * shares[1]
        # Of a tipping sole only the pressed point stays on the ground.
        v_z += (1.0 - roll) * w_x * y - (1.0 - pitch) * w_y * x
        turn, in_sole, up = self.turn, self._scratch, self.normal
        in_sole[0], in_sole[1], in_sole[2] = roll * w_x, pitch * w_y, 0.0
        R.dot(in_sole, out=turn)
        turn[2] = 0.0
        turn_x, turn_y, _ = turn.tolist()
        here_x, here_y, _ = soles.p_sole[support].tolist()
        ahead, left, _ = soles.p_sole[1 - support].tolist()
        ahead, left = ahead - here_x, left - here_y
        in_sole[0], in_sole[1], in_sole[2] = v_x, v_y, v_z
        vertical = float(R[2].dot(in_sole))
        self.velocity = vertical + turn_x * left - turn_y * ahead
        n_x, n_y, n_z = up.tolist()
        dt = self._dt
        n_x, n_y, n_z = (
            n_x + dt * (turn_y * n_z),
            n_y - dt * (turn_x * n_z),
            n_z + dt * (turn_x * n_y - turn_y * n_x),
        )
        up[0], up[1], up[2] = n_x, n_y, n_z
        self.middle_over_support = 0.5 * (-n_x / n_z * ahead + -n_y / n_z * left)
        # The part of the sole's turns since it stands that is not the ground's.
        kept_x, kept_y, _ = self._in_sole.tolist()
        off_x, off_y, _ = up.dot(R).tolist()
        blend *= turns
        in_sole[0] = (kept_x - off_x) * (blend * pitch_room)
        in_sole[1] = (kept_y - off_y) * (blend * roll_room)
        in_sole[2] = 0.0
        off_x, off_y, off_z = R.dot(in_sole).tolist()
        self._point(n_x + off_x, n_y + off_y, n_z + off_z)

    def slope(self) -> tuple[float, float]:
        """Return how the plane rises ahead and to the left [1]."""
        x, y, z = self.normal.tolist()
        return -x / z, -y / z

    def _point(self, x: float, y: float, z: float) -> None:
        """Point the normal there; it has unit length and is not too steep."""
        level = math.hypot(x, y)
        if level > STEEPEST:
            x, y = x * STEEPEST / level, y * STEEPEST / level
            z = 1.0
        length = math.sqrt(x * x + y * y + z * z)
        self.normal[:] = x / length, y / length, z / length
