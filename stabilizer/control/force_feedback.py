"""The wrench law: how each sole should move, given what it feels.

The contact constraint of the second QP in the paper's section IV-B.

A standing foot follows r = -Lambda_c^-1 K^-1 e_F, plus, where switched on, its own
estimated twist: the ground's motion fed forward, which the paper treats as a
disturbance. Along the sole and about its normal a leak pulls it back to the stance,
since a tangential wrench error integrated for ever walks the feet apart. A lifted
foot descends at a bounded speed, its moment terms frozen, until it finds the ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ContactSettings, DikSettings, GroundSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.dynamics import NORMAL, SOLE_ROWS, Dynamics
from surefoot.stabilizer.model import yaw_from


class ForceFeedback:
    """Wanted sole twists.

    Attributes:
        r: (12,) desired twists of left and right sole, sole frames.
        ground_twist: (12,) low-passed sole twists with the servos' lag made up for,
            sole frames.
        minus_K_inv: (12,) diagonal of -K^-1.
        blend: of the low-pass, per tick.
        lead: of the feed-forward, in ticks.
    """

    def __init__(
        self,
        dik: DikSettings,
        ground: GroundSettings,
        contact: ContactSettings,
        *,
        half_sizes: Sequence[tuple[float, float]],
        period_s: float,
        lag_s: float = 0.0,
    ) -> None:
        """Precompute gains.

        Args:
            dik: gains of the law.
            ground: feed-forward of the ground's motion.
            contact: search for the ground.
            half_sizes: half length and half width of left and right sole [m].
            period_s: time between two updates [s].
            lag_s: lag of the servos' set-points beside the servo law's own [s]. The
                loop through the feet is slower by it, so K grows with it.
        """
        self._lag_s = lag_s
        self.minus_K_inv = np.zeros(12)
        self._half_sizes = half_sizes
        linear, angular = dik.yield_limit_m_s, dik.yield_limit_rad_s
        self._yield_limit = np.array(([linear] * 3 + [angular] * 3) * 2)
        self._contact = contact
        self._firm_force = ground.firm_force_n
        self._edge_begins = ground.edge_begins
        self._recovery = period_s / ground.recovery_s
        self._turn_recovery = period_s / ground.edge_recovery_s
        self._share = [1.0, 1.0]
        self._turn_share = [[1.0, 1.0], [1.0, 1.0]]
        self.blend = -math.expm1(-2.0 * math.pi * ground.cutoff_hz * period_s)
        self.lead = (ground.lead_s + lag_s) / period_s
        self._low_passed = np.zeros(12)
        self._e = np.zeros(12)
        self._scaled = np.zeros(12)
        self.ground_twist: Array = np.zeros(12)
        self.r: Array = np.zeros(12)
        self.retune(dik, ground)

    def retune(self, dik: DikSettings, ground: GroundSettings) -> None:
        """Take new gains; limits and filters stay as they were built."""
        stiffer = 1.0 + self._lag_s / dik.k_lag_s
        self.minus_K_inv[:] = -1.0 / (stiffer * np.array(dik.k_force * 2))
        self._leak = dik.stance_leak
        self._ground_gain = ground.gain

    def suspend_feed_forward(self, side: int) -> None:
        """Take a foot's motion for its own, not its ground's, until it stood a while.

        Args:
            side: left or right.
        """
        self._low_passed[SOLE_ROWS[side]] = 0.0
        self._share[side] = 0.0
        self._turn_share[side][:] = [0.0, 0.0]

    def update(
        self,
        dynamics: Dynamics,
        stance: Stance,
        *,
        F_meas: Array,
        F_id: Array,
        in_contact: list[bool],
    ) -> Array:
        """Compute the twists of this tick.

        Args:
            dynamics: quantities at the present state.
            stance: where the feet belong.
            F_meas: (12,) measured wrenches of the ground on the soles.
            F_id: (12,) desired wrenches.
            in_contact: which feet stand.

        Returns:
            (12,) r, reused by the next call.
        """
        e_F = self._e
        np.subtract(F_meas, F_id, out=e_F)
        for side, rows in enumerate(SOLE_ROWS):
            if not in_contact[side]:
                e_F[rows] = 0.0
        np.multiply(e_F, self.minus_K_inv, out=self._scaled)
        dynamics.Lambda_c_inv.dot(self._scaled, out=self.r)
        np.minimum(self.r, self._yield_limit, out=self.r)
        np.maximum(self.r, -self._yield_limit, out=self.r)
        change = self.blend * (dynamics.v_sole - self._low_passed)
        self._low_passed += change
        np.multiply(change, self.lead, out=self.ground_twist)
        self.ground_twist += self._low_passed
        for side, rows in enumerate(SOLE_ROWS):
            F = F_meas[rows].tolist()
            if in_contact[side]:
                self._feed_forward(side, F)
            else:
                self._search(side, dynamics, F[NORMAL])
            self._pull_to_stance(side, dynamics, stance)
        return self.r

    def _feed_forward(self, side: int, F: list[float]) -> None:
        """Have a foot that stands firmly move with its ground.

        A foot that bounces does not show the ground's motion but its own, so its
        share drops at once and returns slowly. The same holds for the rotation of a
        foot pressed at its edge: it may be tipping over that edge. What is on the
        ground then is the centre of pressure alone, and only its velocity is the
        ground's.
        """
        normal = F[NORMAL]
        firmness = min(max(normal / self._firm_force, 0.0), 1.0)
        self._share[side] = min(firmness, self._share[side] + self._recovery)
        v_x, v_y, v_z, w_x, w_y, w_z = self.ground_twist[SOLE_ROWS[side]].tolist()
        if normal > 0.0:
            x, y = -F[4] / normal, F[3] / normal
            half_length, half_width = self._half_sizes[side]
            roll = self._turning(side, 0, abs(y) / half_width)
            pitch = self._turning(side, 1, abs(x) / half_length)
            y = min(max(y, -half_width), half_width)
            x = min(max(x, -half_length), half_length)
            v_z += (1.0 - roll) * w_x * y - (1.0 - pitch) * w_y * x
            w_x *= roll
            w_y *= pitch
        share, gain = self._share[side], self._ground_gain
        start = 6 * side
        for i, rate in enumerate((v_x, v_y, v_z, w_x, w_y, w_z)):
            self.r[start + i] += share * gain[i] * rate

    def _turning(self, side: int, axis: int, outward: float) -> float:
        """Return the part of a rotation that is the ground's: it drops at once.

        Args:
            side: left or right.
            axis: 0 for roll, 1 for pitch.
            outward: centre of pressure from the sole's middle (0) to its edge (1).
        """
        room = (1.0 - outward) / (1.0 - self._edge_begins)
        shares = self._turn_share[side]
        share = min(max(room, 0.0), 1.0, shares[axis] + self._turn_recovery)
        shares[axis] = share
        return share

    def _search(self, side: int, dynamics: Dynamics, normal: float) -> None:
        """Have a lifted foot go down, along the world's vertical."""
        self._share[side] = 0.0
        rows = SOLE_ROWS[side]
        index = 6 * side + NORMAL
        speed = (
            dynamics.Lambda_c_inv[index, index]
            * (self._contact.search_force_n - normal)
            * self.minus_K_inv[index]
        )
        speed = min(max(speed, 0.0), self._contact.descent_limit_m_s)
        self.r[rows] = 0.0
        self.r[rows.start : rows.start + 3] = -speed * dynamics.R_world_sole[side][2]

    def _pull_to_stance(self, side: int, dynamics: Dynamics, stance: Stance) -> None:
        R = dynamics.R_world_sole[side]
        offset = stance.p_sole[side] - dynamics.p_sole[side]
        offset[2] = 0.0
        start = 6 * side
        pull = offset @ R
        self.r[start] += self._leak * pull[0]
        self.r[start + 1] += self._leak * pull[1]
        yaw = yaw_from(R, stance.yaw_sole[side])
        self.r[start + 5] -= self._leak * yaw
