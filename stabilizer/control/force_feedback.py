"""The wrench law: how each sole should move, given what it feels.

The contact constraint of the second QP in the paper's section IV-B.

A standing foot follows r = -Lambda_c^-1 K^-1 e_F, plus, where switched on, its own
estimated twist: the ground's motion fed forward, which the paper treats as a
disturbance. Along the sole and about its normal a leak pulls it back to the stance,
since a tangential wrench error integrated for ever walks the feet apart. A foot whose
pressure is wanted at its edge is kept from tipping over that edge. A lifted foot
descends at a bounded speed, its moment terms frozen, until it finds the ground.

Locked and narrow joints are held in Lambda_c: asked for twists that the legs cannot do,
the second QP does others, which answer no error, and the robot shakes itself over.
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
"""Of the weight: a foot that carries so much stands firmly, however light the robot;
with half of it, it does so on both feet [1]."""
SEARCH_SHARE = 0.115
"""Of the weight: what a lifted foot reaches for at least. The legs of a heavy robot
take more to go down as fast [1]."""


class ForceFeedback:
    """Wanted sole twists.

    Attributes:
        r: (12,) desired twists of left and right sole, sole frames.
        ground_twist: (12,) low-passed sole twists with the servos' lag made up for,
            sole frames.
        firmness: 1 while both feet stand firmly, 0 from the moment that one does not,
            and slowly back; without lag always 1 [1].
        inverse: part of the drives' inverse that the commands are to go through: as
            much as the stand is firm, but no less than ``dik.least_inverse`` [1].
        stiffness: factor on K that the delay of the loop asks for, 1 or more [1].
        minus_K_inv: (12,) diagonal of -K^-1.
        blend: of the low-pass, per tick.
        lead: of the feed-forward, in ticks.
        share: part of the motion of left and right foot that is its ground's: less of
            one that has bounced [1].
        landing: whether the left and the right foot feel the impact of a touchdown:
            their wrench errors then count as no more than ``landing_force_n``.
        walks: whether steps are under way: then no stand is a firm one, and the ground
            may be soft.
        turns: part of the soles' turns that may be their ground's: who walks steps on
            edges, too, about which a sole tips [1].
        soft_ground: what the soles do because it is, taken off their motion.
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
            lag_s: lag of the servos' set-points beside the servo law's own [s]. It is
                made up for while the feet stand firmly; else K grows with it, since
                the loop through the feet must be slower than its delays.
            speed: of the fastest mode with the default K, see
                :func:`surefoot.stabilizer.control.drives.fastest_mode` [1/s].
            weight: of the robot [N].
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
        """Take readings to be so old from now on: yield less, and look ahead.

        Args:
            forces_s: largest age of the force readings [s].
            motion_s: mean age of what tells the soles' motion [s].
        """
        self._forces_s = forces_s
        self._lead_s = self._ground_lead_s + motion_s
        self._set_stiffness()

    def suspend_feed_forward(self, side: int) -> None:
        """Take a foot's motion for its own, not its ground's, until it stood a bit."""
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
        if self._lag_s:
            self._judge_stand(F_meas, in_contact)
        e_F = self._e
        np.subtract(F_meas, F_id, out=e_F)
        for side, rows in enumerate(SOLE_ROWS):
            if not in_contact[side]:
                e_F[rows] = 0.0
            elif self.landing[side]:
                self._soften(e_F[rows])
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
        """Be soft as soon as a foot does not stand firmly, and for a while after."""
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
        self._firm_K_inv = -1.0 / (self.stiffness * self._k_force)
        # As stiff as it has to be without the inverse, if it is not already.
        self._soft = max(0.0, self._lag_stiffness / self.stiffness - 1.0)
        self._set_firmness(self.firmness)

    def _set_firmness(self, firmness: float) -> None:
        self.firmness = firmness
        soft = 1.0 - firmness
        np.divide(self._firm_K_inv, 1.0 + soft * self._soft, out=self.minus_K_inv)
        self.inverse = max(firmness, self._least_inverse)
        lag_s = (1.0 - self.inverse) * self._lag_s
        self.lead = (self._lead_s + lag_s) / self._period_s

    def _soften(self, e_F: Array) -> None:
        """Scale down the wrench error of a landing foot, in place.

        The impact is over before the servos have answered it: what they did about it
        would come when the foot has just come to rest.
        """
        normal = abs(e_F.item(NORMAL))
        if normal > self._landing_force:
            e_F *= self._landing_force / normal

    def _keep_flat(
        self, side: int, F: list[float], F_id: list[float], dynamics: Dynamics
    ) -> None:
        """Have a foot that is to be pressed at its edge not tip over that edge.

        There the centre of pressure stays however far the foot tips, and where it is
        wanted at the edge as well, no error of the moment shows it: the errors of other
        axes, which the inertia couples in, turn the foot on and on, and it slaps down
        when the pressure is wanted elsewhere. So there its own moment alone turns it,
        and never further over; the point on the ground moves as before.
        """
        if F[NORMAL] <= 0.0 or F_id[NORMAL] <= 0.0:
            return
        half_length, half_width = self._half_sizes[side]
        for axis, half in ((3, half_width), (4, half_length)):
            index = 6 * side + axis
            # Velocity of the pressed point along the normal is v_z + turn * arm.
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
        """Have a foot that stands firmly move with its ground.

        A foot that bounces does not show the ground's motion but its own, so its
        share drops at once and returns slowly. The same holds for the rotation of a
        foot pressed at its edge: it may be tipping over that edge. What is on the
        ground then is the centre of pressure alone, and only its velocity is the
        ground's.
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
        """Return the part of a rotation that is the ground's: it drops at once.

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
        """Have a lifted foot go down, along the world's vertical.

        As fast with slow drives and with old readings as with others: what K grows for
        is a loop through the ground, and while a foot is in the air the robot tips over
        the other one.
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
    """Return 1 well inside the sole, 0 at its edge, in proportion between.

    Args:
        outward: centre of pressure from the sole's middle (0) to its edge (1).
        begins: where it is less than 1.
        ends: where it is 0.
    """
    if outward >= ends:
        return 0.0
    return 1.0 if outward <= begins else (ends - outward) / (ends - begins)
