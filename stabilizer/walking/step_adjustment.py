"""Adjusts place and time of the present step, by a small QP, when the DCM is off.

In single support with the ZMP at p the DCM xi moves away from it. After a time T it is
p + s (xi - p), with s = exp(w T), as in Khadiv et al. 2016, "Step timing adjustment: a
step toward generating robust gaits". Then, in double support of duration D, the ZMP
moves evenly to the place u of the landed foot. When that foot begins to carry alone,
the DCM should be at u + b, where b is what the following steps ask for. Together this
relates place, time and offset:

    s (xi - p) = g (u - p) + d b,    d = exp(-w D),    g = (1 - d) / (w D)

which is linear in u, s and b. The QP changes all three as little as it can, by weight,
within the reach of the legs and the speed of the swing.

A DCM beyond the outer edge of the standing foot cannot be caught by a step to the
moving foot's own side. That foot then crosses to the other side, ahead of the standing
one and so far that the legs do not meet. The next step goes around behind.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.model import turn_level
from surefoot.stabilizer.qp import DenseQp, QpSolution
from surefoot.stabilizer.walking.dcm import Point
from surefoot.stabilizer.walking.footsteps import FOOT_SHARE, Foothold, LegSpeed
from surefoot.stabilizer.walking.gait import Gait
from surefoot.stabilizer.walking.step_queue import Move

EVERY_TICKS = 4
"""Ticks between two solutions of the QP."""
SETTLED_S = 0.1
"""Time after which a foot has reached its shifted goal [s]."""
ACROSS_M = 0.02
"""Margin by which a crossing foot may go farther to the other side than it must: thighs
meet [m]."""
NEARLY_M = 0.02
"""Distance to the passing place at which a foot may pass the other one [m]."""
ARRIVED_M = 0.001
"""Distance to its goal at which a shift has arrived [m]."""
CROSSING_M_S = 5.0
"""Largest speed of the shift when feet cross or part again, if the drives allow it."""
_AHEAD, _ASIDE, _GROWTH = range(3)
"""Unknowns: shift ahead and to the left [m], and s over its plan [1]."""


class StepAdjustment:
    """Shift in place and time of the present step from its plan.

    Attributes:
        shift: (x, y) of the present step, odometry frame [m].
    """

    def __init__(
        self,
        settings: WalkSettings,
        *,
        nearest: float,
        half_sizes: tuple[float, float],
        leg_speed: LegSpeed,
        period_s: float,
    ) -> None:
        """Begin without a shift.

        Args:
            settings: dead band, weights, speed and limits.
            nearest: least sideways distance of parallel feet [m].
            half_sizes: half length and half width of a sole [m].
            leg_speed: of the slower leg.
            period_s: time between two updates [s].
        """
        self._settings, self._dt = settings, period_s
        self._nearest, self._half_sizes = nearest, half_sizes
        self.shift: Point = (0.0, 0.0)
        self._own = 1.0
        self._goal: Point = (0.0, 0.0)
        self._error: Point = (0.0, 0.0)
        self._planned_s = 0.0
        self._is_over = True
        self._ticks = 0
        self._is_outward = self._crosses = self._is_across = False
        self._may_cross = (
            settings.adjust == "both"
            and 0.0 < settings.cross_ahead_m <= settings.longest_m
        )
        crossing = min(CROSSING_M_S, FOOT_SHARE * leg_speed.travel)
        self._rates = (settings.adjust_rate_m_s, crossing)
        self._qp = DenseQp("step adjustment", n=3, m=0)
        self._weights: Array = np.array([1.0, 1.0, settings.adjust_growth_m**2])
        self._row: Array = np.zeros(3)

    def begin(self, move: Move, *, start: Point, support: Foothold) -> None:
        """Begin a step.

        Args:
            move: the step.
            start: place of the foot, odometry frame [m].
            support: foothold of the other foot.
        """
        self._own = 1.0 if move.side == 0 else -1.0
        self._crosses = False
        self._is_across = self._own * _seen(start, support)[1] < 0.0
        self.shift = self._goal = self._error = (0.0, 0.0)
        self._planned_s = move.single_s
        self._is_over = self._settings.adjust == "off"
        self._ticks = 0

    def stop(self) -> None:
        """End the shift: the foot is down and stays."""
        self._is_over = True

    def update(
        self,
        error: tuple[float, float],
        move: Move,
        *,
        gait: Gait,
        support: Foothold,
        least_left_s: Callable[[Move, Point], float],
        foot: tuple[Point, Point],
    ) -> tuple[float, float]:
        """Advance by one tick; may change how long the gait's single support lasts.

        Args:
            error: DCM minus its reference, odometry frame [m].
            move: the step, as planned.
            gait: has time, ZMP and reference of the DCM.
            support: foothold of the other foot.
            least_left_s: returns the least time that the foot needs for a shift [s].
            foot: place of the foot on its path, and where it would be without the shift
                [m].

        Returns:
            (x, y) by which the following steps are to be moved, too [m].
        """
        settings = self._settings
        if self._is_over:
            return 0.0, 0.0
        old_x, old_y = self._error
        blend = min(1.0, self._dt / settings.adjust_filter_s)
        x, y = old_x + blend * (error[0] - old_x), old_y + blend * (error[1] - old_y)
        self._error = (x, y)
        ahead, left = turn_level(x, y, -support.yaw)
        dead_ahead, dead_left = settings.adjust_dead_m
        beyond = (_dead(ahead, dead_ahead), _dead(left, dead_left))
        is_due = (
            self._ticks % EVERY_TICKS == 0 and gait.left_s >= settings.adjust_until_s
        )
        if is_due and self._fill(beyond, move, gait, support):
            self._bound(move, gait, support, least_left_s(move, self.shift))
            self._take(self._qp.solve(), gait, support)
        self._ticks += 1
        return self._follow_goal(move, support, foot)

    def _plan_left_s(self, gait: Gait) -> float:
        """Return the time of single support that the plan leaves [s]."""
        return max(self._planned_s - gait.t, self._settings.adjust_until_s)

    def _fill(self, beyond: Point, move: Move, gait: Gait, support: Foothold) -> bool:
        """Write the cost; return whether the error is more than the ankles can end.

        The rest goes into b, which weighs most.
        """
        settings, omega, qp, row = self._settings, gait.omega, self._qp, self._row
        growth = math.exp(omega * self._plan_left_s(gait))
        outward = -1.0 if move.side == 0 else 1.0
        half_length, half_width = self._half_sizes
        share = settings.adjust_zmp_share
        is_over = beyond[_ASIDE] * outward > 0.0
        edges = (share * half_length, half_width if is_over else share * half_width)
        # The ankles end the error with the step, if the sole is large enough.
        wanted = [error * growth / (growth - 1.0) for error in beyond]
        if all(abs(zmp) <= edge for zmp, edge in zip(wanted, edges, strict=True)):
            return False
        zmps = [
            min(max(zmp, -edge), edge) for zmp, edge in zip(wanted, edges, strict=True)
        ]
        growth_now = math.exp(omega * gait.left_s)
        spread = omega * move.double_s
        d = math.exp(-spread)
        g = -math.expm1(-spread) / spread
        weight = (settings.adjust_offset_weight / d) ** 2
        (p_x, p_y), (xi_x, xi_y) = gait.zmp, gait.dcm
        place = turn_level(*self.shift, -support.yaw)
        reference = turn_level(xi_x - p_x, xi_y - p_y, -support.yaw)
        qp.P.fill(0.0)
        qp.P[range(3), range(3)] = self._weights
        qp.q_lin.fill(0.0)
        qp.q_lin[_GROWTH] = -self._weights[_GROWTH]
        for axis in (_AHEAD, _ASIDE):
            xi = reference[axis] + beyond[axis] - zmps[axis]
            # The reference, with present shift and time, leads where it should.
            led = growth_now * reference[axis] - g * place[axis]
            row.fill(0.0)
            row[axis], row[_GROWTH] = -g, growth * xi
            qp.P += weight * np.outer(row, row)
            qp.q_lin += (weight * (zmps[axis] - led)) * row
        self._is_outward = xi * outward > 0.0
        if self._is_outward and self._may_cross:
            self._crosses = self._is_across = True
        return True

    def _bound(self, move: Move, gait: Gait, support: Foothold, least_s: float) -> None:
        """Write the bounds: reach of the legs, earliest and latest touchdown."""
        settings, qp, omega = self._settings, self._qp, gait.omega
        limit_x, limit_y = settings.adjust_limit_m
        p_x, p_y, yaw = move.place.seen_from(support)
        half_length, half_width = self._half_sizes
        # A sole that is turned has a corner nearer to the other foot.
        corner = abs(math.sin(yaw)) * half_length + math.cos(yaw) * half_width
        nearest = self._nearest + corner - half_width
        qp.x_l[_AHEAD] = max(-limit_x, min(0.0, -settings.longest_m - p_x))
        qp.x_u[_AHEAD] = min(limit_x, max(0.0, settings.longest_m - p_x))
        low = max(-limit_y, min(0.0, nearest - abs(p_y)))
        high = min(limit_y, max(0.0, settings.farthest_m - abs(p_y)))
        if self._crosses:
            qp.x_l[_AHEAD] = settings.cross_ahead_m - p_x
            qp.x_u[_AHEAD] = settings.longest_m - p_x
            high = -nearest - abs(p_y)
            low = high - ACROSS_M
        if move.side == 1:
            low, high = -high, -low
        qp.x_l[_ASIDE], qp.x_u[_ASIDE] = low, high
        left_s = self._plan_left_s(gait)
        soonest = latest = left_s
        if settings.adjust == "both":
            most_s = self._planned_s + settings.adjust_wait_s - gait.t
            soonest = max(
                least_s, settings.adjust_until_s, min(self._reach_s(), most_s)
            )
            if self._is_outward and not self._is_across:
                soonest = max(soonest, left_s)
            latest = max(most_s, soonest)
        qp.x_l[_GROWTH] = math.exp(omega * (soonest - left_s))
        qp.x_u[_GROWTH] = math.exp(omega * (latest - left_s))

    def _take(self, solution: QpSolution, gait: Gait, support: Foothold) -> None:
        if solution.ok:
            ahead, left, growth = solution.x.tolist()
            self._goal = turn_level(ahead, left, support.yaw)
            left_s = self._plan_left_s(gait) + math.log(growth) / gait.omega
            if left_s != gait.left_s:
                gait.duration_s = gait.t + left_s

    def _reach_s(self) -> float:
        """Return the time that the foot needs to get to its shifted place [s]."""
        x, y = self._goal[0] - self.shift[0], self._goal[1] - self.shift[1]
        way = math.hypot(x, y)
        return way / min(self._rates) + SETTLED_S if way > ARRIVED_M else 0.0

    def _follow_goal(
        self, move: Move, support: Foothold, foot: tuple[Point, Point]
    ) -> Point:
        """Move the shift towards its goal, no faster than a leg can follow."""
        goal = self._goal
        if goal == self.shift and not self._is_across:
            return 0.0, 0.0
        most = self._dt * self._rates[self._is_across]
        if self._is_across:
            goal = self._led_around(goal, move, support, foot)
        x, y = goal[0] - self.shift[0], goal[1] - self.shift[1]
        share = min(1.0, most / max(math.hypot(x, y), most))
        x, y = share * x, share * y
        self.shift = (self.shift[0] + x, self.shift[1] + y)
        # The following steps keep the shift ahead, and half of that to the side; all of
        # it once the feet have crossed.
        ahead, left = turn_level(x, y, -support.yaw)
        kept = 1.0 if self._is_across else 0.5
        return turn_level(ahead, kept * left, support.yaw)

    def _led_around(
        self, goal: Point, move: Move, support: Foothold, foot: tuple[Point, Point]
    ) -> Point:
        """Return a shift that leads the foot around the other one to its goal.

        The foot passes the other one only far enough ahead of it, or behind.
        """
        own, nearest = self._own, self._nearest
        passes = self._settings.cross_ahead_m
        (ahead, left), (path_ahead, path_left) = (_seen(p, support) for p in foot)
        apart = own * left
        to_ahead, to_left = turn_level(*goal, -support.yaw)
        end = own * (move.place.seen_from(support)[1] + to_left)
        at, beside = path_ahead + to_ahead, own * (path_left + to_left)
        if apart < nearest - NEARLY_M:
            # On its way past the other foot, or beyond it.
            at = max(at, passes) if ahead > 0.0 else min(at, -passes)
            beside = end
        elif end < nearest:
            # Still on its own side: ahead first.
            at = max(at, passes)
            beside = end if ahead > passes - NEARLY_M else max(beside, nearest)
        shift = (at - path_ahead, own * beside - path_left)
        return turn_level(*shift, support.yaw)


def _seen(point: Point, foot: Foothold) -> Point:
    """Return a point in the axes of a foothold, from its middle [m]."""
    return turn_level(point[0] - foot.x, point[1] - foot.y, -foot.yaw)


def _dead(value: float, band: float) -> float:
    return math.copysign(max(abs(value) - band, 0.0), value)
