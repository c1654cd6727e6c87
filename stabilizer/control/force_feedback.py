"""Wrench law: desired sole twists from measured and desired wrenches.

It is the contact constraint of the second QP, section IV-B of the paper, and sits
between the first QP (TSID) and the second (DIK).

A standing foot follows r = -Lambda_c^-1 K^-1 e_F. Feed-forward, if switched on, adds
its estimated twist: the ground's motion, which the paper treats as a disturbance. A
leak pulls the foot back to the stance, along the sole and about its normal: an
integrated tangential error would walk the feet apart. A foot with desired pressure at
its edge is kept from tipping over it. A lifted foot descends at a bounded speed without
moment terms until it finds the ground.

Locked and narrow joints are held in Lambda_c. If r asked for twists that the legs
cannot do, the second QP would do others. Those answer no error, and the robot shakes
itself over.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.law_settings import DikSettings, GroundSettings
from surefoot.schemas.settings import ContactSettings
from surefoot.stabilizer.control.drives import needed_stiffness, ticks_of
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.control.soft_ground import SoftGround
from surefoot.stabilizer.dynamics import NORMAL, SOLE_ROWS, Dynamics
from surefoot.stabilizer.model import yaw_from

FIRM_SHARE = 0.3
"""Part of the weight above which a foot stands firmly, however light the robot; with
half the weight on each, both feet do [1]."""
SEARCH_SHARE = 0.115
"""Least force that a lifted foot seeks, as a part of the weight. The legs of a heavy
robot need a larger one to descend as fast [1]."""
AHEAD_S = 0.012
"""Look-ahead of normal forces in a walk, for each multiple of the default K beyond the
first: three times a flat foot's lag, since one on its edge lags more [s]."""
SMOOTHING_S = 0.02
"""Time over which the rate of these forces is smoothed [s]."""


class ForceFeedback:
    """Desired sole twists.

    Attributes:
        r: (12,) desired twists of left and right sole, sole frames.
        ground_twist: (12,) low-passed sole twists with the servos' lag compensated,
            sole frames [m/s, rad/s].
        firmness: 1 while both feet stand firmly; 0 at once when one does not, then
            slowly back to 1. Always 1 without lag [1].
        inverse: part of the drives' inverse to use for commands: ``firmness``, but no
            less than ``dik.least_inverse`` [1].
        stiffness: factor on K that the loop delay requires, 1 or more [1].
        minus_K_inv: (12,) diagonal of -K^-1.
        blend: coefficient of the low-pass, per tick.
        lead: lead of the feed-forward [ticks].
        share: part of each foot's motion that is its ground's, left and right; lower
            after a bounce [1].
        landing: whether left and right foot feel the impact of a touchdown; their
            wrench errors are then limited to ``landing_force_n``.
        walks: whether steps are under way; no stand is firm then, and the ground may be
            soft.
        turns: part of the soles' turns that may be their ground's; 1 in standing, less
            in walking on edges, about which a sole tips [1].
        soft_ground: motion of the soles due to soft ground, removed from
            ``ground_twist``.
    """

    def __init__(
        self,
        dik: DikSettings,
        ground: GroundSettings,
        contact: ContactSettings,
        *,
        half_sizes: Sequence[tuple[float, float]],
        sole_scale: float,
        period_s: float,
        lag_s: float = 0.0,
        speed: float = 0.0,
        weight: float,
        landing_force_n: float = math.inf,
    ) -> None:
        """Precompute gains.

        Args:
            dik: gains of the law.
            ground: feed-forward of the ground's motion.
            contact: search for the ground.
            half_sizes: half length and half width of left and right sole [m].
            sole_scale: part of them that desired centres of pressure may use [1].
            period_s: time between two updates [s].
            lag_s: lag of the servos' set-points in addition to the servo law's own [s].
                It is compensated while the feet stand firmly. Otherwise K grows with
                it, since the loop through the feet must be slower than its delays.
            speed: speed of the fastest mode with the default K, see
                :func:`surefoot.stabilizer.control.drives.fastest_mode` [1/s].
            weight: weight of the robot [N].
            landing_force_n: largest normal force error that a landing foot yields to
                [N].
        """
        self._lag_s, self._period_s, self._speed = lag_s, period_s, speed
        self.firmness = self.inverse = 1.0
        self._firm_again = period_s / dik.firm_again_s
        self.landing, self.walks, self.turns = [False, False], False, 1.0
        self.minus_K_inv = np.zeros(12)
        self._half_sizes = half_sizes
        self._sole_scale = sole_scale
        linear, angular = dik.yield_limit_m_s, dik.yield_limit_rad_s
        self._yield_limit = np.array(([linear] * 3 + [angular] * 3) * 2)
        self._least_twist = -self._yield_limit
        self._descent_limit = contact.descent_limit_m_s
        self._search_force = max(contact.search_force_n, SEARCH_SHARE * weight)
        self._firm_force = min(ground.firm_force_n, FIRM_SHARE * weight)
        self._edge_begins = ground.edge_begins
        self._kept_flat = dik.keep_flat
        self._recovery = period_s / ground.recovery_s
        self._turn_recovery = period_s / ground.edge_recovery_s
        self.share = [1.0, 1.0]
        self._turn_share = [[1.0, 1.0], [1.0, 1.0]]
        self.blend = -math.expm1(-2.0 * math.pi * ground.cutoff_hz * period_s)
        self._ground_lead_s = self._lead_s = ground.lead_s
        self._forces_s = 0.0
        self.lead = ground.lead_s / period_s
        self.soft_ground = SoftGround(half_sizes=half_sizes, period_s=period_s)
        self._low_passed = np.zeros(12)
        self._smoothing = period_s / (period_s + SMOOTHING_S)
        self._wanted = [0.0, 0.0]
        self._e = np.zeros(12)
        self._scaled = np.zeros(12)
        self.ground_twist: Array = np.zeros(12)
        self._landing_force = landing_force_n
        self.r: Array = np.zeros(12)
        self.retune(dik, ground)

    def retune(self, dik: DikSettings, ground: GroundSettings) -> None:
        """Take new gains; limits and filters stay as they were built."""
        self._k_force = np.array(dik.k_force * 2)
        self._search_K_inv = -1.0 / self._k_force
        self._delay_s = max(dik.loop_delay_s, self._period_s)
        self._lag_stiffness = 1.0 + self._lag_s / dik.k_lag_s
        self._least_inverse = dik.least_inverse
        self._set_stiffness()
        self._leak = dik.stance_leak
        self._ground_gain = ground.gain

    def expect_age(self, *, forces_s: float, motion_s: float) -> None:
        """Allow for readings of this age from now on: yield less, and look ahead.

        Args:
            forces_s: largest age of the force readings [s].
            motion_s: mean age of the readings that show the soles' motion [s].
        """
        self._forces_s = forces_s
        self._lead_s = self._ground_lead_s + motion_s
        self._set_stiffness()

    def suspend_feed_forward(self, side: int) -> None:
        """Stop feed-forward for a foot until it has stood for a while."""
        self._low_passed[SOLE_ROWS[side]] = 0.0
        self.share[side] = 0.0
        self._turn_share[side][:] = [0.0, 0.0]

    def update(
        self,
        dynamics: Dynamics,
        stance: Stance,
        *,
        F_meas: Array,
        F_id: Array,
        in_contact: list[bool],
        airborne: int | None = None,
    ) -> Array:
        """Compute the twists of this tick.

        Args:
            dynamics: quantities at the present state.
            stance: has the places of the feet.
            F_meas: (12,) measured wrenches of the ground on the soles.
            F_id: (12,) desired wrenches.
            in_contact: which feet stand.
            airborne: the foot that a walk has in the air, if any; it writes that twist.

        Returns:
            (12,) r, reused by the next call.
        """
        if self._lag_s:
            self._judge_stand(F_meas, in_contact)
        e_F = self._e
        np.subtract(F_meas, F_id, out=e_F)
        shifts = self.walks and all(in_contact)
        for side, rows in enumerate(SOLE_ROWS):
            coming = self._coming(side, F_id.item(6 * side + NORMAL))
            if not in_contact[side]:
                e_F[rows] = 0.0
            elif self.landing[side]:
                self._soften(e_F[rows])
            elif shifts:
                e_F[6 * side + NORMAL] -= coming
        np.multiply(e_F, self.minus_K_inv, out=self._scaled)
        dynamics.mobility.dot(self._scaled, out=self.r)
        np.minimum(self.r, self._yield_limit, out=self.r)
        np.maximum(self.r, self._least_twist, out=self.r)
        change = self.blend * (dynamics.v_sole - self._low_passed)
        if self.walks:
            stands = [in_contact[side] and not self.landing[side] for side in range(2)]
            self.soft_ground.update(dynamics.v_sole, F_meas, stands)
            change += self.blend * self.soft_ground.given
        self._low_passed += change
        np.multiply(change, self.lead, out=self.ground_twist)
        self.ground_twist += self._low_passed
        for side, rows in enumerate(SOLE_ROWS):
            if side == airborne:
                self.share[side] = 0.0
                continue
            F = F_meas[rows].tolist()
            if in_contact[side]:
                if self._kept_flat and not self.walks:  # a step may roll
                    self._keep_flat(side, F, F_id[rows].tolist(), dynamics)
                self._feed_forward(side, F)
            else:
                self._search(side, dynamics, F[NORMAL])
            self._pull_to_stance(side, dynamics, stance)
        return self.r

    def _judge_stand(self, F_meas: Array, in_contact: list[bool]) -> None:
        """Drop the firmness at once when a foot is not firm; raise it slowly."""
        left, right = F_meas.item(NORMAL), F_meas.item(6 + NORMAL)
        stands = all(in_contact) and not self.walks
        if stands and min(left, right) > self._firm_force:
            self._set_firmness(min(1.0, self.firmness + self._firm_again))
        else:
            self._set_firmness(0.0)

    def _set_stiffness(self) -> None:
        delay_s = self._delay_s + self._forces_s
        self.stiffness = needed_stiffness(
            self._speed,
            delay_ticks=ticks_of(delay_s, self._period_s),
            period_s=self._period_s,
        )
        self._ahead = AHEAD_S * (self.stiffness - 1.0) / SMOOTHING_S
        self._firm_K_inv = -1.0 / (self.stiffness * self._k_force)
        # Stiff enough to do without the inverse, if it is not already.
        self._soft = max(0.0, self._lag_stiffness / self.stiffness - 1.0)
        self._set_firmness(self.firmness)

    def _set_firmness(self, firmness: float) -> None:
        self.firmness = firmness
        soft = 1.0 - firmness
        np.divide(self._firm_K_inv, 1.0 + soft * self._soft, out=self.minus_K_inv)
        self.inverse = max(firmness, self._least_inverse)
        lag_s = (1.0 - self.inverse) * self._lag_s
        self.lead = (self._lead_s + lag_s) / self._period_s

    def _coming(self, side: int, wanted: float) -> float:
        """Return by how much a wanted normal force will have changed soon [N].

        With a stiff K the force lags. The weight then leaves a foot late, and the DCM
        of a walk goes past the other one.
        """
        change = wanted - self._wanted[side]
        self._wanted[side] += self._smoothing * change
        return self._ahead * change

    def _soften(self, e_F: Array) -> None:
        """Scale down the wrench error of a landing foot, in place.

        The impact is over before the servos answer it. Their answer would come when the
        foot has just come to rest.
        """
        normal = abs(e_F.item(NORMAL))
        if normal > self._landing_force:
            e_F *= self._landing_force / normal

    def _keep_flat(
        self, side: int, F: list[float], F_id: list[float], dynamics: Dynamics
    ) -> None:
        """Keep a foot with desired pressure at its edge from tipping over that edge.

        The centre of pressure stays at the edge however far the foot tips. If it is
        also desired there, the moment error shows nothing. Errors of other axes,
        coupled in by the inertia, then turn the foot on and on; it slaps down once the
        pressure is desired elsewhere. So the foot is turned by its own moment alone,
        and never further over. The pressed point moves as before.
        """
        if F[NORMAL] <= 0.0 or F_id[NORMAL] <= 0.0:
            return
        half_length, half_width = self._half_sizes[side]
        for axis, half in ((3, half_width), (4, half_length)):
            index = 6 * side + axis
            # The pressed point's velocity along the normal is v_z + turn * arm.
            arm = F[axis] / F[NORMAL]
            outward = abs(arm) / half
            if outward <= self._sole_scale:  # most ticks, so at once
                continue
            lowers = math.copysign(1.0, arm)  # turning so, the far edge goes down
            turn = lowers * self.r[index]
            if turn >= 0.0:
                continue
            wanted = lowers * F_id[axis] / F_id[NORMAL]
            room = max(
                _room(outward, begins=self._sole_scale, ends=1.0),
                _room(wanted / half, begins=self._edge_begins, ends=self._sole_scale),
            )
            own = lowers * dynamics.mobility[index, index] * self._scaled[index]
            free = 1.0 - self._kept_flat * (1.0 - room)
            kept = free * turn + (1.0 - free) * max(own, 0.0)
            self.r[index] = lowers * kept
            self.r[6 * side + NORMAL] += (turn - kept) * min(abs(arm), half)

    def _feed_forward(self, side: int, F: list[float]) -> None:
        """Make a foot that stands firmly move with its ground.

        A bouncing foot shows its own motion, not the ground's, so its share drops at
        once and returns slowly. The same holds for the rotation of a foot pressed at
        its edge: it may be tipping over that edge. Only its centre of pressure is on
        the ground then, and only the velocity of that point is the ground's.
        """
        normal = F[NORMAL]
        firmness = min(max(normal / self._firm_force, 0.0), 1.0)
        self.share[side] = min(firmness, self.share[side] + self._recovery)
        v_x, v_y, v_z, w_x, w_y, w_z = self.ground_twist[SOLE_ROWS[side]].tolist()
        if normal > 0.0:
            x, y = -F[4] / normal, F[3] / normal
            half_length, half_width = self._half_sizes[side]
            roll = self.turns * self._turning(side, 0, abs(y) / half_width)
            pitch = self.turns * self._turning(side, 1, abs(x) / half_length)
            y = min(max(y, -half_width), half_width)
            x = min(max(x, -half_length), half_length)
            v_z += (1.0 - roll) * w_x * y - (1.0 - pitch) * w_y * x
            w_x *= roll
            w_y *= pitch
        share, gain = self.share[side], self._ground_gain
        start = 6 * side
        for i, rate in enumerate((v_x, v_y, v_z, w_x, w_y, w_z)):
            self.r[start + i] += share * gain[i] * rate

    def _turning(self, side: int, axis: int, outward: float) -> float:
        """Return the part of a rotation that is the ground's; it drops at once.

        Args:
            side: left or right.
            axis: 0 for roll, 1 for pitch.
            outward: centre of pressure from the sole's middle (0) to its edge (1).
        """
        shares = self._turn_share[side]
        share = min(
            _room(outward, begins=self._edge_begins, ends=1.0),
            shares[axis] + self._turn_recovery,
        )
        shares[axis] = share
        return share

    def _search(self, side: int, dynamics: Dynamics, normal: float) -> None:
        """Lower a lifted foot along the world's vertical.

        Its speed does not depend on slow drives or old readings: K grows for a loop
        through the ground, and with a foot in the air the robot tips over the other
        one.
        """
        self.share[side] = 0.0
        rows = SOLE_ROWS[side]
        index = 6 * side + NORMAL
        speed = (
            dynamics.mobility[index, index]
            * (self._search_force - normal)
            * self._search_K_inv[index]
        )
        speed = min(max(speed, 0.0), self._descent_limit)
        self.r[rows] = 0.0
        self.r[rows.start : rows.start + 3] = -speed * dynamics.R_world_sole[side][2]

    def _pull_to_stance(self, side: int, dynamics: Dynamics, stance: Stance) -> None:
        R = dynamics.R_world_sole[side]
        offset = stance.p_sole[side] - dynamics.p_sole[side]
        offset[2] = 0.0
        start = 6 * side
        along_x, along_y, _ = offset.dot(R).tolist()
        self.r[start] += self._leak * along_x
        self.r[start + 1] += self._leak * along_y
        yaw = yaw_from(R, stance.yaw_sole[side])
        self.r[start + 5] -= self._leak * yaw


def _room(outward: float, *, begins: float, ends: float) -> float:
    """Return 1 well inside the sole, 0 at its edge, and in proportion between.

    Args:
        outward: centre of pressure from the sole's middle (0) to its edge (1).
        begins: position from which the result is less than 1.
        ends: position at which the result is 0.
    """
    if outward >= ends:
        return 0.0
    return 1.0 if outward <= begins else (ends - outward) / (ends - begins)
