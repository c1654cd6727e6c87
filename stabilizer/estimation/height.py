"""Height in the world: integrated accelerations, pulled to the legs' kinematics."""

from __future__ import annotations

import math

from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.dynamics import part_between
from surefoot.stabilizer.estimation.felt_motion import UsualDifference
from surefoot.stabilizer.estimation.ground_swing import GroundSwing

GROUND_SPEED_MEMORY_S = 3.0
"""Time for which ground that moved still counts as moving."""
AT_END_MEMORY_S = 0.5
"""The same at the stroke's end: ground that has come to rest there is left behind."""
GROUND_SPEED_CUTOFF = 0.5
"""Cutoff of the ground's speed: slower changes are the accelerometer's drift
[rad/s]."""
STILL_DAMPING = 0.7
"""Damping ratio of the pull of the height on still ground."""
STILL_BIAS_PULL, STILL_LEARNING = 0.5, 5.0
"""Rate at which the accelerometer's bias follows on still ground [rad/s]; at first this
number over the time that the ground has stood [1]."""
STILL_FOR_BIAS = 0.99
"""Stillness from which an error is the accelerometer's; ground that begins to move is
excluded."""
MOVES = 0.5
"""Stillness below which the ground moves."""
STILL_WEIGHT = 50.0
"""Weight of still ground against ground that moves, for learning [1]."""
LEAST_KNOWN_S = 0.3
"""Least time watched: shorter ones make gains that noise would shake [s]."""
LEARNING, BIAS_LEARNING = 3.0, 0.5
"""Bandwidths times the time watched, while that gives more than the settings [1]."""
KNOWN_S = 5.0
"""Time after which the height is trusted; a fiftieth of it on still ground."""
GROUND_M, GROUND_M_S, LIKELY_BIAS_M_S2 = 0.05, 0.3, 0.05
"""Standard deviations for ground that moves at the start: height, speed, and bias not
yet seen, if feet and accelerometer agree."""
GROUND_CORRELATION_S = 0.25
"""Time for which moving ground keeps its height."""
DOUBT = 4.0
"""Factor on the variance of what is learnt: swinging ground is no random noise [1]."""
RETURNED_M, RETURNED_M_S = 0.01, 0.01
"""Distance from level and speed at which the ground has returned from the stroke's end
[m], [m/s]."""
SMALL_MEAN_M_S2 = 0.012
"""Mean acceleration at the start that may be noise [m/s^2]."""
DOUBTED_S, STILL_IN_DOUBT = 0.5, 0.95
"""Time after the start [s] and stillness [1]: if stillness falls below this within the
time, a mean that feet and accelerometer share was the ground's."""
AGREE_M_S2 = 0.05
"""Difference up to which feet and accelerometer agree [m/s^2]."""
GRAVITY_MARGIN_M_S2 = 0.05
"""Difference of gravity from place to place [m/s^2]."""
CHANGE_M_S, FEWEST_READINGS = 0.015, 50
"""An acceleration is the ground's if its change in the time watched, times that time,
is more [m/s]; and the fewest readings for that."""
BRAKING_M_S2 = 1.5
"""The level follows ground that nears the stroke's end once stopping it there would
take this deceleration; no platform within the stroke needs as much [m/s^2]."""
KNOWN_SHARE = 0.9
"""Share of an estimate good enough to tell where the stroke's end is [1]."""
LEAST_ROOM_M = 0.005
"""Least room to the stroke's end to stop in [m]."""
LEVEL_MOVES_M_S = 0.02
"""Speed of the level above which the legs' pull cannot lead to it [m/s]."""
LEVEL_RESTS_S = 0.3
"""Time constant with which a level comes to rest that is no longer pushed."""
TAKEN_MEMORY_S = 20.0
"""Memory of how far the ground has taken the level along."""
RIDES_FROM, RIDES = 1.0, 2.0
"""Distances, in parts of the legs' stroke, by which ground must have taken the level
along to be ridden in part, and fully [1]."""
RIDE_LAG_S = 0.5
"""Time constant with which riding begins and ends [s]."""
AT_END = 0.2
"""Part of the pull left at the stroke's end, where the error tells nothing."""


class HeightFilter:
    """Height and its rate for one point of the robot, half way from IMU to CoM.

    The accelerometer and the foot forces both give the acceleration; their mean has
    less noise and drift than either. Its integral is pulled to the legs' kinematics,
    which tell the height over the ground: hard on still ground, softly on moving
    ground. With e the height by the legs minus the estimate,

        h' = rate + k_1 e,   rate' = acceleration - bias + k_2 e,   bias' = -k_3 e

    where the roots of s^3 + k_1 s^2 + k_2 s + k_3 are a pair, by bandwidth and damping,
    and the pull of the bias. After a start on moving ground the gains of a Kalman
    filter without prior knowledge (:class:`Learnt`) are used for as long as they are
    greater. The less is known, the more the robot rides with the ground.

    The ground is assumed level on average, within the legs' stroke. Until the height is
    known, an estimate beyond is wrong, and so are rate and bias. Later, ground that
    goes farther takes the level along, gently and from before the stroke's end. From
    there the pull leads back without overshoot. If this goes on, as on a ship's deck,
    the ground is ridden: only the height over it counts. Height and rate refer to the
    level.

    Attributes:
        height: over level ground [m].
        rate: its rate [m/s].
        bias: bias of the mean acceleration, or gravity's difference at this place
            [m/s^2].
        ground: height of the ground from level [m].
    """

    def __init__(
        self,
        settings: EstimatorSettings,
        *,
        stroke: tuple[float, float],
        period_s: float,
    ) -> None:
        """Set the gains.

        Args:
            settings: bandwidths and damping.
            stroke: lowest and highest ground, from level, that the legs can follow [m].
            period_s: time between two updates [s].
        """
        self._settings = settings
        self._stroke = stroke
        self._whole_stroke = max(stroke[1] - stroke[0], LEAST_ROOM_M)
        self._dt = period_s
        self._forget = math.exp(-period_s / GROUND_SPEED_MEMORY_S)
        self._forget_at_end = math.exp(-period_s / AT_END_MEMORY_S)
        self._count = 0
        self._sum = self._moment = 0.0
        self.height = self.rate = self.bias = self.ground = 0.0
        self._height = self._rate = 0.0
        self._known_s = self._still_s = LEAST_KNOWN_S
        self._learnt: Learnt | None = None
        self._returns = False
        self._doubted_s = 0.0
        self._feet = UsualDifference(period_s=period_s)
        self._is_at_end = self._is_taken = False
        self._over = self._level_rate = self._taken = self._ride = 0.0
        self._forget_taken = math.exp(-period_s / TAKEN_MEMORY_S)
        self._felt_speed = self._leg_mean = self._speed_mean = 0.0
        self._speed = self._ground_speed = 0.0
        self._swing = GroundSwing(period_s=period_s)

    def calibrate(
        self,
        acceleration: float,
        difference: float | None,
        *,
        height: float,
        rate: float,
        moves: bool,
    ) -> None:
        """Take one reading of a robot that keeps its posture.

        Args:
            acceleration: vertical, by the accelerometer [m/s^2].
            difference: vertical acceleration by the accelerometer minus that by the
                feet's forces; None: unknown [m/s^2].
            height: of the point over the ground, by the legs [m].
            rate: its rate [m/s].
            moves: whether the ground turns, so that the mean is not only bias. A mean
                that changes shows heaving ground, too.
        """
        self._count += 1
        self._known_s = self._still_s = max(self._count * self._dt, LEAST_KNOWN_S)
        self._sum += acceleration
        self._moment += self._count * acceleration
        mean = self._sum / self._count
        if self._count >= FEWEST_READINGS:
            lopsided = self._moment - 0.5 * (self._count + 1) * self._sum
            least = CHANGE_M_S / (self._count * self._dt)
            moves = moves or abs(12.0 * lopsided) > least * self._count**2
        self._feet.calibrate(difference)
        # Evenly accelerating ground looks like a bias, but not to the feet. These have
        # an error by what the robot carries; that both agree by chance is unlikely.
        margin = 0.0 if moves else GRAVITY_MARGIN_M_S2
        if not moves and abs(self._feet.usual) > AGREE_M_S2:
            margin = math.inf
        self.bias = bias = self._near_feet(mean, margin)
        is_shared = mean == bias and margin < math.inf
        is_doubted = not moves and (is_shared or abs(mean) <= SMALL_MEAN_M_S2)
        self._doubted_s = DOUBTED_S if is_doubted else 0.0
        self.height, self.rate, self.ground = height, rate, 0.0
        self._height, self._rate = height, rate
        self._leg_mean = rate
        self._ground_speed = 0.1 if moves else 0.0
        # What feet and accelerometer share is the ground or chance; time will show.
        # On moving ground the bias may be all by which accelerometer and feet differ.
        likely = math.hypot(LIKELY_BIAS_M_S2, self._feet.usual)
        self._doubt(likely if moves else abs(mean - bias))

    def update(
        self,
        acceleration: float,
        difference: float | None,
        *,
        over: float,
        rate: float,
        steps: bool = False,
    ) -> None:
        """Advance by one period.

        Args:
            acceleration: vertical, by the accelerometer [m/s^2].
            difference: as for :meth:`calibrate`.
            over: height of the point over the ground, by the legs [m].
            rate: its rate [m/s].
            steps: whether the robot walks; its ground changes, so no swing is learnt.
        """
        dt = self._dt
        acceleration -= 0.5 * self._feet.unusual(difference)
        self.bias += 0.5 * self._feet.change
        stillness = self._stillness(acceleration - self.bias, rate)
        if self._doubted_s > 0.0:
            self._doubted_s -= dt
            if stillness < STILL_IN_DOUBT:
                before, self._doubted_s = self.bias, 0.0
                self.bias = self._near_feet(before, 0.0)
                self._doubt(abs(before - self.bias))
        k_1, k_2, k_3 = self._gains(stillness)
        error = over - self._height
        swing = self._swing
        swing.update(self._speed)
        is_led = self._is_at_end or self._is_taken
        if steps or is_led or stillness > MOVES or not self._is_known:
            swing.forget()
        else:
            moves = (1.0 - stillness) * (1.0 - self._ride)
            error = swing.follow(error, size=self._ground_speed, moves=moves)
            share, (s_1, s_2, s_3) = swing.share, swing.gains
            k_1 += share * (s_1 - k_1)
            k_2 += share * (s_2 - k_2)
            k_3 += share * (s_3 - k_3)
        by_rate, by_bias = k_2 / k_1, k_3 / k_1
        self._go_along(self._rate - rate)
        is_led = self._is_at_end or abs(self._level_rate) > LEVEL_MOVES_M_S
        if is_led and stillness < MOVES:
            k_2, k_3 = AT_END * k_2, AT_END * k_3
        self._height += dt * (self._rate - self._level_rate + k_1 * error)
        self._rate += dt * (acceleration - self.bias + k_2 * error)
        self.bias -= dt * k_3 * error
        ground = self._height - over
        lowest, highest = self._stroke
        within = min(max(ground, lowest), highest)
        self._height += within - ground
        if not self._is_known:  # nor are rate and bias, by what they share with it
            self._rate += by_rate * (within - ground)
            self.bias -= by_bias * (within - ground)
        self._over = within
        self._is_at_end = within != ground
        if self._is_taken or self._is_at_end:
            self._returns = True
        elif abs(within) < RETURNED_M and abs(self._rate - rate) < RETURNED_M_S:
            self._returns = False
        learnt = self._learnt
        share = min(1.0, self._known_s / KNOWN_S) if learnt is None else learnt.share
        share *= 1.0 - self._riding()
        self.ground = share * within
        self.height = over + self.ground
        self.rate = rate + share * (self._rate - self._level_rate - rate)

    def _doubt(self, size: float) -> None:
        """Learn anew a bias that may be so large, where that matters [m/s^2]."""
        self._learnt = Learnt(size) if size > SMALL_MEAN_M_S2 else None

    def _near_feet(self, mean: float, margin: float) -> float:
        """Return what of a mean the feet do not share, within a margin [m/s^2]."""
        usual = self._feet.usual
        return min(max(mean, min(0.0, usual) - margin), max(0.0, usual) + margin)

    def _go_along(self, speed: float) -> None:
        """Move the level along with ground that nears the stroke's end.

        It begins as late as gentle braking allows. Legs that reach their end at speed
        lose the ground.

        Args:
            speed: of the ground [m/s].
        """
        lowest, highest = self._stroke
        closing = speed - self._level_rate
        room = highest - self._over if closing > 0.0 else self._over - lowest
        braking = closing * closing / (2.0 * max(room, LEAST_ROOM_M))
        self._taken *= self._forget_taken
        is_met = self._is_at_end or braking > BRAKING_M_S2
        self._is_taken = self._is_known and is_met
        if self._is_taken:
            braking = min(braking, 2.0 * BRAKING_M_S2)
            self._level_rate += math.copysign(braking * self._dt, closing)
            most = RIDES * self._whole_stroke
            self._taken = min(self._taken + abs(speed) * self._dt, most)
        elif self._level_rate:
            self._level_rate -= self._dt / LEVEL_RESTS_S * self._level_rate

    @property
    def _is_known(self) -> bool:
        return self._learnt is None or self._learnt.share > KNOWN_SHARE

    def _riding(self) -> float:
        """Return the part of the ground's motion that the robot follows [1]."""
        parts = self._taken / self._whole_stroke
        wanted = part_between(parts, RIDES_FROM, RIDES)
        self._ride += self._dt / RIDE_LAG_S * (wanted - self._ride)
        return self._ride

    def _stillness(self, acceleration: float, leg_rate: float) -> float:
        """Return 1 on ground that stands still, 0 on ground that moves.

        The ground's speed is the integrated acceleration minus the speed by the legs,
        without its slow part. Neither bias nor height enter: they depend on this very
        judgement and would hold it up.
        """
        step = self._dt * GROUND_SPEED_CUTOFF
        self._felt_speed += self._dt * acceleration - step * self._felt_speed
        self._leg_mean += step * (leg_rate - self._leg_mean)
        speed = self._felt_speed - (leg_rate - self._leg_mean)
        self._speed_mean += step * (speed - self._speed_mean)
        self._speed = speed - self._speed_mean
        forget = self._forget_at_end if self._is_at_end else self._forget
        self._ground_speed = max(abs(self._speed), self._ground_speed * forget)
        ratio = self._ground_speed / self._settings.still_speed_m_s
        stillness: float = 1.0 / (1.0 + ratio**4)
        return stillness

    def _gains(self, stillness: float) -> tuple[float, float, float]:
        """Return k_1, k_2, k_3."""
        s = self._settings
        w = _between(s.height_bandwidth, s.still_height_bandwidth, stillness)
        damping = _between(s.height_damping, STILL_DAMPING, stillness)
        is_still = stillness > STILL_FOR_BIAS
        p = s.height_bias_pull
        if is_still:
            self._still_s += self._dt
            p = max(STILL_BIAS_PULL, STILL_LEARNING / self._still_s)
        if self._returns:
            damping = STILL_DAMPING
        weight = 1.0 + stillness * STILL_WEIGHT
        if self._learnt is not None:
            k_1, k_2, k_3 = _poles(w, damping, p)
            l_1, l_2, l_3 = self._learnt.step(self._dt, weight=weight)
            return max(k_1, l_1), max(k_2, l_2), max(k_3, l_3)
        self._known_s += self._dt * weight
        known_s = self._known_s
        if w * known_s < LEARNING:
            w, damping = LEARNING / known_s, STILL_DAMPING
        return _poles(w, damping, max(p, BIAS_LEARNING / known_s))


class Learnt:
    """Knowledge of the ground when it moved at the filter's start.

    Covariance of height, rate and bias. The ground's height is noise that keeps for a
    while: the more often it is seen, the better its mean is known.
    """

    def __init__(self, bias: float) -> None:
        """Begin with likely values.

        Args:
            bias: standard deviation of the unseen bias [m/s^2].
        """
        self._hh, self._rr, self._bb = GROUND_M**2, GROUND_M_S**2, bias**2
        self._hr = self._hb = self._rb = 0.0

    @property
    def share(self) -> float:
        """Part of the estimated height to trust [1]."""
        return GROUND_M**2 / (GROUND_M**2 + DOUBT * self._hh)

    def step(self, dt: float, *, weight: float) -> tuple[float, float, float]:
        """Advance by a tick; return the gains k_1, k_2, k_3 of the best estimate.

        Args:
            dt: time since the last [s].
            weight: weight of the legs' height, more on still ground [1].
        """
        hh, hr, hb = self._hh, self._hr, self._hb
        rr, rb, bb = self._rr, self._rb, self._bb
        hh += dt * (2.0 * hr + dt * rr)
        hr += dt * (rr - hb - dt * rb)
        hb += dt * rb
        rr += dt * (dt * bb - 2.0 * rb)
        rb -= dt * bb
        total = hh + GROUND_M**2 * GROUND_CORRELATION_S / (dt * weight)
        k_h, k_r, k_b = hh / total, hr / total, hb / total
        self._hh, self._hr, self._hb = hh - k_h * hh, hr - k_h * hr, hb - k_h * hb
        self._rr, self._rb, self._bb = rr - k_r * hr, rb - k_r * hb, bb - k_b * hb
        return k_h / dt, k_r / dt, -k_b / dt


def _poles(bandwidth: float, damping: float, pull: float) -> tuple[float, float, float]:
    swing, square = 2.0 * damping * bandwidth, bandwidth * bandwidth
    return swing + pull, square + swing * pull, square * pull


def _between(moving: float, still: float, stillness: float) -> float:
    return moving + stillness * (still - moving)
