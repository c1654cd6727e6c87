"""Floating-base state from the robot's own sensors; ground truth is never read.

The IMU gives the base's attitude. The legs give its horizontal position: an anchor
between the soles, weighted by load, is assumed to stay at its nominal place. So on
moving ground the state is relative to the feet, which is what balance needs. The height
refers to the world: the accelerometer is integrated twice and only slowly pulled to the
legs' kinematics, so heaving ground is seen to heave. The observer calls it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.settings import EstimatorSettings
from surefoot.stabilizer.estimation.attitude import AttitudeFilter
from surefoot.stabilizer.estimation.contact import Anchors
from surefoot.stabilizer.estimation.felt_motion import (
    DOUBT_M_S2,
    FeltMotion,
    GroundAcceleration,
    HorizontalBias,
)
from surefoot.stabilizer.estimation.height import HeightFilter
from surefoot.stabilizer.model import GRAVITY, RobotModel, yaw_from

_ORIGIN = np.zeros(3)
LEAST_TRACE = 0.1
"""Least trace of a rotation whose quaternion has a real part to divide by [1]."""
MIN_TOTAL_FORCE_N = 50.0
"""Total force below which the load share keeps its last value [N]."""
FIRM_SHARE = 0.1
"""Part of the weight on a foot that surely does not hop [1]."""
SAME_TIME_S = 0.0025
"""Longest tick in which forces and accelerations are compared in motion: forces refer
to the end of a tick, accelerations to its mean. In longer ticks they only agree at rest
[s]."""


class Estimator:
    """Base pose and twist; joints as measured.

    Attributes:
        q: (7 + n_a,) configuration in the stance frame, joints in model order.
        v: (6 + n_a,) velocity.
        R_world_base: (3, 3) base rotation.
        height: base height in the world relative to level ground [m].
        height_rate: rate of ``height`` [m/s].
        ground_height: height of the anchor between the soles, from nominal [m].
    """

    def __init__(
        self, model: RobotModel, settings: EstimatorSettings, *, period_s: float
    ) -> None:
        """Allocate everything; begin with :meth:`calibrate`."""
        self._model = model
        self._settings = settings
        self._dt = period_s
        self._data = model.pin_model.createData()
        self._attitude = AttitudeFilter(
            tilt_bandwidth=settings.tilt_bandwidth,
            bias_gain=settings.gyro_bias_gain,
            still_rate=settings.still_rate_rad_s,
            ahead=model.T_base_imu.rotation[0],
            period_s=period_s,
        )
        self._R_imu_base = model.T_base_imu.rotation.T.copy()
        self._p_base_imu = model.T_base_imu.translation.tolist()
        self.R_world_base = np.eye(3)
        blend = -math.expm1(-2.0 * math.pi * settings.anchor_cutoff_hz * period_s)
        self._share_blend = blend
        self._left_share = 0.5
        nominal = model.nominal_configuration()
        pin.framesForwardKinematics(model.pin_model, self._data, nominal)
        soles = [self._data.oMf[i] for i in model.sole_ids]
        self.anchors = Anchors(
            [sole.translation for sole in soles],
            [yaw_from(sole.rotation, 0.0) for sole in soles],
        )
        # Views of Pinocchio's results: requesting one anew costs more than reading.
        self._R_sole = [sole.rotation for sole in soles]
        self._p_sole = [sole.translation for sole in soles]
        self._com_view, self._v_com_view = self._data.com[0], self._data.vcom[0]
        self._leg_velocity = np.zeros(3)
        self._velocity = np.zeros(3)
        self._lever = np.zeros(3)
        self._unit_velocity: Vec3 = np.zeros(3)
        self._rows = self.R_world_base.tolist()
        self._sole_yaw = 0.0
        self._anchor = (0.0, 0.0, 0.0)
        self._soles = [
            (R, p.tolist()) for R, p in zip(self._R_sole, self._p_sole, strict=True)
        ]
        self._com = self._v_com = [0.0, 0.0, 0.0]
        self._lift = self._lift_rate = 0.0
        self.q: Array = nominal.copy()
        self.v: Array = np.zeros(model.n_v)
        self.height = float(nominal[2])
        self.height_rate = 0.0
        self.ground_height = 0.0
        lowest, highest = model.com_travel
        self._vertical = HeightFilter(
            settings, stroke=(-highest, -lowest), period_s=period_s
        )
        self._felt_motion = FeltMotion(model, period_s=period_s)
        self._ground = GroundAcceleration(period_s=period_s)
        self._least_firm = FIRM_SHARE * model.weight
        self._accel_bias = HorizontalBias(
            memory_s=settings.accel_bias_memory_s, period_s=period_s
        )
        self._felt: Vec3 = np.zeros(3)
        self._passed: list[list[float]] = []
        self._is_firm = False

    def calibrate(self, snapshot: Snapshot, *, wrenches: Array | None) -> bool:
        """Take one reading of a robot that keeps its posture.

        Args:
            snapshot: reading of all sensors.
            wrenches: (12,) last measured sole wrenches, sole frames [N, N m]; None:
                unknown.

        Returns:
            Whether the ground surely turns: a robot held on it may fall.
        """
        attitude = self._attitude
        attitude.rate[:] = snapshot.angular_velocity
        self._read(snapshot)
        attitude.calibrate(
            snapshot.angular_velocity,
            snapshot.linear_acceleration,
            accel_bias=self._R_imu_base @ self._accel_bias.bias,
            leg_rate=self._leg_rate(),
            leg_velocity=self._unit_velocity,
            leg_up=self._leg_up(),
        )
        self._read(snapshot)
        attitude.start_from(self._unit_velocity)
        difference = self._compare(snapshot, wrenches)
        over, rate = self._point_over_ground()
        self._vertical.calibrate(
            self._acceleration(self._felt.item(2)),
            difference,
            height=over,
            rate=rate,
            moves=attitude.ground_turns,
        )
        self._take_height()
        self._place()
        return attitude.surely_turns

    def update(self, snapshot: Snapshot, *, wrenches: Array | None) -> None:
        """Advance by one tick.

        Args:
            snapshot: reading of all sensors.
            wrenches: (12,) last measured sole wrenches, sole frames [N, N m]; None:
                unknown.
        """
        self._attitude.update(
            snapshot.angular_velocity,
            snapshot.linear_acceleration - self._R_imu_base.dot(self._accel_bias.bias),
            leg_velocity=self._unit_velocity,
        )
        self._update_share(wrenches)
        self._read(snapshot)
        if self._attitude.looks_for_rest:
            self._attitude.rest_on(self._leg_rate())
        difference = self._compare(snapshot, wrenches)
        over, rate = self._point_over_ground()
        if self._passed:
            self._make_up(over, rate)
        if self._dt > SAME_TIME_S:
            difference = None
        self._vertical.update(
            self._acceleration(self._felt.item(2)),
            difference,
            over=over,
            rate=rate,
            steps=self.anchors.by_load,
        )
        self._take_height()
        self._place()
        if not all(self.anchors.planted):
            self._follow_feet()
        self._pull_yaw()

    def pass_over(self, snapshot: Snapshot) -> None:
        """Turn with the gyroscope, and keep what the accelerometer feels for later.

        The legs tell their own part of the acceleration when they are read again.

        Args:
            snapshot: reading of all sensors of a tick that gets no answer.
        """
        attitude, accel = self._attitude, snapshot.linear_acceleration
        bias = self._accel_bias.bias
        attitude.update(
            snapshot.angular_velocity,
            accel - self._R_imu_base.dot(bias),
            leg_velocity=self._unit_velocity,
        )
        felt = attitude.R_world_imu.dot(accel) - self.R_world_base.dot(bias)
        self._passed.append(felt.tolist())

    @property
    def ground_acceleration(self) -> list[float]:
        """Horizontal acceleration of the ground, (2,) world axes [m/s^2]."""
        return self._ground.acceleration

    @property
    def force_offsets(self) -> list[float]:
        """Errors of the normal forces (measured minus true), left and right [N]."""
        return self._felt_motion.offsets

    @property
    def gyro_is_off(self) -> bool:
        """Whether the learnt bias of the gyroscope has changed since the start."""
        return self._attitude.gyro_is_off

    @property
    def doubt(self) -> str:
        """Why the readings at rest cannot all be right; empty if they can.

        Nothing is said on ground that turns. A push looks like such ground.
        """
        off = math.hypot(*self._accel_bias.seen)
        if off <= DOUBT_M_S2 or self._attitude.ground_turns:
            return ""
        return (
            f"accelerometer and feet differ by {off:.1f} m/s^2 at rest: it is off, or "
            "the robot is pulled"
        )

    def _read(self, snapshot: Snapshot) -> None:
        """Fill q and v from joints and attitude; then see the base by the legs."""
        model, data, attitude = self._model, self._data, self._attitude
        pin_model = model.pin_model
        q, v = self.q, self.v
        q[7:] = snapshot.q[model.to_model]
        v[6:] = snapshot.dq[model.to_model]
        attitude.R_world_imu.dot(self._R_imu_base, out=self.R_world_base)
        self._rows = self.R_world_base.tolist()
        q[:3] = 0.0
        q[3:7] = self._quaternion()
        v[:3] = 0.0
        attitude.rate.dot(self._R_imu_base, out=v[3:6])
        pin.centerOfMass(pin_model, data, q, v, False)
        left, right = model.sole_ids
        world = pin.LOCAL_WORLD_ALIGNED
        pin.updateFramePlacement(pin_model, data, left)
        pin.updateFramePlacement(pin_model, data, right)
        R_left, R_right = self._R_sole
        p_left, p_right = (p.tolist() for p in self._p_sole)
        self._soles = [(R_left, p_left), (R_right, p_right)]
        self._com, self._v_com = self._com_view.tolist(), self._v_com_view.tolist()
        # Twists of the soles for a base that only rotates.
        l_x, l_y, l_z = pin.getFrameVelocity(
            pin_model, data, left, world
        ).linear.tolist()
        r_x, r_y, r_z = pin.getFrameVelocity(
            pin_model, data, right, world
        ).linear.tolist()
        share = self._left_share
        rest = 1.0 - share
        self._anchor = (
            p_left[0] * share + p_right[0] * rest,
            p_left[1] * share + p_right[1] * rest,
            p_left[2] * share + p_right[2] * rest,
        )
        less = share - 1.0
        self._leg_velocity[:] = (
            l_x * -share + r_x * less,
            l_y * -share + r_y * less,
            l_z * -share + r_z * less,
        )
        yaw_left, yaw_right = self.anchors.yaw
        turn_left, turn_right = yaw_from(R_left, yaw_left), yaw_from(R_right, yaw_right)
        if self.anchors.by_load:
            self._sole_yaw = share * turn_left + (1.0 - share) * turn_right
        else:
            self._sole_yaw = 0.5 * (turn_left + turn_right)
        self._see_unit()

    def _quaternion(self) -> list[float]:
        """Return the base's rotation as x, y, z, w, as Eigen computes it.

        Computed in plain numbers: the bindings would need three objects.
        """
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self._rows
        trace = xx + (yy + zz)
        if trace < LEAST_TRACE:  # Not by pin.Quaternion of a matrix: it leaks 80 bytes.
            turned: list[float] = pin.SE3ToXYZQUAT(
                pin.SE3(self.R_world_base, _ORIGIN)
            ).tolist()
            return turned[3:]
        root = math.sqrt(trace + 1.0)
        scale = 0.5 / root
        return [(zy - yz) * scale, (xz - zx) * scale, (yx - xy) * scale, 0.5 * root]

    def _see_unit(self) -> None:
        """Compute the IMU's velocity by the legs, world [m/s], and the point's height.

        The point, whose height is filtered, is half way from the IMU to the centre of
        mass. Its lift is relative to the base's origin.
        """
        w_x, w_y, w_z = self.v[3:6].tolist()
        p_x, p_y, p_z = self._p_base_imu
        s_x, s_y, s_z = (
            w_y * p_z - w_z * p_y,
            w_z * p_x - w_x * p_z,
            w_x * p_y - w_y * p_x,
        )
        self._lever[:] = s_x, s_y, s_z
        self.R_world_base.dot(self._lever, out=self._unit_velocity)
        self._unit_velocity += self._leg_velocity
        up_x, up_y, up_z = self._rows[2]
        lift = up_x * p_x + up_y * p_y + up_z * p_z
        rate = up_x * s_x + up_y * s_y + up_z * s_z
        self._lift = 0.5 * (lift + self._com[2])
        self._lift_rate = 0.5 * (rate + self._v_com[2])

    def _leg_rate(self) -> Vec3:
        """Return the angular velocity that the legs see, IMU frame, (3,) [rad/s]."""
        model, data = self._model, self._data
        rate = np.zeros(3)
        for frame in model.sole_ids:
            twist = pin.getFrameVelocity(
                model.pin_model, data, frame, pin.LOCAL_WORLD_ALIGNED
            )
            rate -= 0.5 * twist.angular
        seen: Vec3 = self._attitude.rate + rate @ self._attitude.R_world_imu
        return seen

    def _leg_up(self) -> Vec3:
        """Return the normal of the soles, IMU frame, (3,)."""
        left, right = (R[:, 2] for R in self._R_sole)
        up: Vec3 = (left + right) @ self._attitude.R_world_imu
        return up / np.linalg.norm(up)

    def _place(self) -> None:
        """Set base position and velocity from the anchor and the height."""
        q, v = self.q, self.v
        share = self._left_share
        left, right = self.anchors.p
        q[0] = share * left[0] + (1.0 - share) * right[0] - self._anchor[0]
        q[1] = share * left[1] + (1.0 - share) * right[1] - self._anchor[1]
        q[2] = self.height
        velocity = self._velocity
        velocity[:] = self._leg_velocity
        velocity[2] = self.height_rate
        velocity.dot(self.R_world_base, out=v[:3])

    def _update_share(self, wrenches: Array | None) -> None:
        if wrenches is None:
            return
        left, right = max(wrenches.item(2), 0.0), max(wrenches.item(8), 0.0)
        if left + right > MIN_TOTAL_FORCE_N:
            share = left / (left + right)
            self._left_share += self._share_blend * (share - self._left_share)
        self._left_share = self.anchors.share(self._left_share)

    def _follow_feet(self) -> None:
        """Move the anchors of feet that are not planted along with them."""
        anchors, q, soles = self.anchors, self.q, self._soles
        for side, (R, (x, y, z)) in enumerate(soles):
            if anchors.planted[side]:
                continue
            rise = z - soles[1 - side][1][2]
            p = anchors.p[side]
            p[:] = q.item(0) + x, q.item(1) + y, anchors.p[1 - side][2] + rise
            anchors.yaw[side] = yaw_from(R, 0.0)

    def _compare(self, snapshot: Snapshot, wrenches: Array | None) -> float | None:
        """Compare accelerometer and feet; return their vertical difference [m/s^2]."""
        felt, bias = self._felt, self._accel_bias
        self._attitude.R_world_imu.dot(snapshot.linear_acceleration, out=felt)
        feet = self._felt_motion
        is_felt = feet.compare(
            felt=felt.tolist(),
            v_imu=(self._unit_velocity - self._leg_velocity).tolist(),
            com=self._com,
            v_com=self._v_com,
            soles=self._soles,
            wrenches=wrenches,
            ticks=1 + len(self._passed),
        )
        # In walking, impacts and swinging legs spoil the comparison.
        tells = is_felt and not self.anchors.by_load
        if tells:
            bias.learn(feet.by_force, feet.by_pressure, self._rows)
            feet.learn_offsets(self._com, self._soles)
        felt -= self.R_world_base.dot(bias.bias)
        h_x, h_y, _ = felt.tolist()
        r_x, r_y, _ = feet.relative
        self._is_firm = tells and self._stands_on_both(wrenches)
        self._ground.update(
            (h_x - r_x, h_y - r_y), self._com_velocity(), firm=self._is_firm
        )
        return feet.by_force[2] if tells else None

    def _stands_on_both(self, wrenches: Array | None) -> bool:
        if wrenches is None:
            return False
        return min(wrenches.item(2), wrenches.item(8)) > self._least_firm

    def _point_over_ground(self) -> tuple[float, float]:
        """Return height of the filtered point over the ground [m], and its rate.

        The point is half way between the IMU and the centre of mass.
        """
        over = self._lift - self._anchor[2]
        over += self._by_load(self.anchors.level) + self._by_load(self.anchors.relief)
        return over, self._lift_rate + self._leg_velocity.item(2)

    def _by_load(self, heights: Sequence[float]) -> float:
        """Return the height of the carrying foothold, of both footholds' [m]."""
        left, right = heights
        return self._left_share * left + (1.0 - self._left_share) * right

    def _acceleration(self, felt: float) -> float:
        """Return that point's vertical acceleration by the accelerometer [m/s^2]."""
        return felt - GRAVITY - 0.5 * self._felt_motion.relative[2]

    def _make_up(self, over: float, rate: float) -> None:
        """Integrate what was felt in the ticks that got no answer."""
        r_x, r_y, _ = self._felt_motion.relative
        seen = self._com_velocity()
        for x, y, z in self._passed:
            self._vertical.update(
                self._acceleration(z),
                None,
                over=over,
                rate=rate,
                steps=self.anchors.by_load,
            )
            self._ground.update((x - r_x, y - r_y), seen, firm=self._is_firm)
        self._passed.clear()

    def _com_velocity(self) -> tuple[float, float]:
        """Return the horizontal velocity of the CoM over the feet [m/s]."""
        return (
            self._v_com[0] + self._leg_velocity.item(0),
            self._v_com[1] + self._leg_velocity.item(1),
        )

    def _take_height(self) -> None:
        """Set the base's height from that of the filtered point."""
        self.height = self._vertical.height - self._lift
        self.height_rate = self._vertical.rate - self._lift_rate
        anchors = self.anchors
        anchors.carrying = level = self._by_load(anchors.level)
        self.ground_height = self._vertical.ground + level
        self.ground_height += self._by_load(anchors.relief)

    def _pull_yaw(self) -> None:
        """Keep the soles' mean yaw at the stance's, since yaw is not observable."""
        turn = -self._settings.yaw_gain * self._dt * self._sole_yaw
        self._attitude.pull_yaw(turn)
