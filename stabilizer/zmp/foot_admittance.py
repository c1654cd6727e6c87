"""Foot admittance of the ZMP baseline: desired sole twists from the wrench error.

Every foot yields. With its centre of pressure too far forward it lifts its toe; too far
left, its left edge. A foot with more than its share of the load rises relative to the
other.
"""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.dynamics import NORMAL
from surefoot.stabilizer.zmp.dcm_feedback import LeakyIntegrator
from surefoot.stabilizer.zmp.distribution import centre_of_pressure


class FootAdmittance:
    """Desired sole twists of the commanded robot.

    Attributes:
        twist: (12,) of left and right sole, commanded sole frames.
    """

    def __init__(self, settings: ZmpSettings) -> None:
        """Store the gains."""
        self._settings = settings
        self.twist: Array = np.zeros(12)

    def update(
        self,
        *,
        F_meas: Array,
        F_desired: Array,
        in_contact: list[bool],
        R_measured: list[Mat],
        R_commanded: list[Mat],
        p_commanded: list[Vec3],
        p_stance: list[Vec3],
    ) -> Array:
        """Compute the twists of this tick.

        Args:
            F_meas: (12,) measured wrenches of the ground on the soles.
            F_desired: (12,) desired ones.
            in_contact: which feet stand.
            R_measured: rotations of the soles as measured.
            R_commanded: rotations of the commanded soles.
            p_commanded: (3,) positions of the commanded soles [m].
            p_stance: (3,) positions of the soles in the stance [m].

        Returns:
            (12,) twists, reused by the next call.
        """
        self.twist[:] = 0.0
        speeds = self.foot_force_difference(
            F_meas=F_meas,
            F_desired=F_desired,
            in_contact=in_contact,
            R_measured=R_measured,
            heights=(p_commanded[0].item(2), p_commanded[1].item(2)),
            stance_heights=(p_stance[0].item(2), p_stance[1].item(2)),
        )
        for side in (0, 1):
            rows = slice(6 * side, 6 * side + 6)
            if in_contact[side]:
                self.twist[6 * side + 3 : 6 * side + 5] = self.foot_damping(
                    F_meas[rows], F_desired[rows]
                )
            # The world's vertical in the commanded sole frame.
            self.twist[6 * side : 6 * side + 3] = speeds[side] * R_commanded[side][2]
        return self.twist

    def foot_damping(self, F_meas: Array, F_desired: Array) -> tuple[float, float]:
        """Foot damping control: compute the rotation about x and y of one sole [rad/s].

        The desired moment is that of the desired centre of pressure under the measured
        normal force, so that a load error does not turn the foot.

        Args:
            F_meas: (6,) measured wrench, sole frame.
            F_desired: (6,) desired wrench, sole frame.
        """
        settings = self._settings
        cop_x, cop_y = centre_of_pressure(F_desired)
        normal = max(F_meas.item(NORMAL), 0.0)
        error_x = F_meas.item(3) - cop_y * normal
        error_y = F_meas.item(4) + cop_x * normal
        # A moment about x moves the centre of pressure along y.
        along_x, along_y = settings.cop_admittance
        limit = settings.max_fdc_velocity_rad_s
        return _clamp(along_y * error_x, limit), _clamp(along_x * error_y, limit)

    def foot_force_difference(
        self,
        *,
        F_meas: Array,
        F_desired: Array,
        in_contact: list[bool],
        R_measured: list[Mat],
        heights: tuple[float, float],
        stance_heights: tuple[float, float],
    ) -> tuple[float, float]:
        """Compute both vertical speeds [m/s], world up.

        Both feet standing: foot force difference control and vertical drift
        compensation. One foot standing: the other seeks touchdown.

        Args:
            F_meas: (12,) measured wrenches.
            F_desired: (12,) desired ones.
            in_contact: which feet stand.
            R_measured: rotations of the soles as measured.
            heights: of the commanded soles [m].
            stance_heights: of the soles in the stance [m].
        """
        settings = self._settings
        if not (in_contact[0] and in_contact[1]):
            return self._seek_touchdown(0, F_meas, in_contact), self._seek_touchdown(
                1, F_meas, in_contact
            )
        up_left, up_right = R_measured[0][2], R_measured[1][2]
        desired = float(up_left @ F_desired[:3] - up_right @ F_desired[6:9])
        felt = float(up_left @ F_meas[:3] - up_right @ F_meas[6:9])
        height_error = (stance_heights[0] - stance_heights[1]) - (
            heights[0] - heights[1]
        )
        parting = settings.dfz_admittance * (desired - felt)
        parting -= settings.dfz_damping * height_error
        drift = sum(stance_heights) - sum(heights)
        common = settings.vdc_frequency * drift
        limit = settings.max_vertical_velocity_m_s
        return (
            _clamp(0.5 * (common - parting), limit),
            _clamp(0.5 * (common + parting), limit),
        )

    def _seek_touchdown(
        self, side: int, F_meas: Array, in_contact: list[bool]
    ) -> float:
        """Return a lifted foot's speed [m/s]; zero unless the other foot stands."""
        other_stands = in_contact[1 - side]
        if in_contact[side] or not other_stands:
            return 0.0
        settings = self._settings
        missing = settings.touchdown_force_n - F_meas.item(6 * side + NORMAL)
        return -_clamp(
            settings.touchdown_admittance * missing, settings.max_vertical_velocity_m_s
        )


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


class ZmpCompensation:
    """ZMP compensation control (ZMPCC): offset of the CoM reference.

    The CoM moves in the direction in which the measured ZMP exceeds the distributed
    one: cd = -A (z_distributed - z_measured).

    Attributes:
        offset: (3,) [m].
        velocity: (3,) [m/s].
        acceleration: (3,) [m/s^2].
    """

    def __init__(self, settings: ZmpSettings, *, period_s: float) -> None:
        """Start without offset."""
        self._gain = np.array([*settings.com_admittance, 0.0])
        self._dt = period_s
        self._integral = LeakyIntegrator(
            leak=settings.zmpcc_integrator_leak_rate,
            limit=settings.max_com_offset_m,
            period_s=period_s,
        )
        self.offset: Vec3 = self._integral.value
        self.velocity: Vec3 = np.zeros(3)
        self.acceleration: Vec3 = np.zeros(3)

    def update(self, *, distributed: Vec3, measured: Vec3, active: bool) -> None:
        """Advance by one tick.

        Args:
            distributed: (3,) ZMP of the distributed wrenches [m].
            measured: (3,) measured ZMP [m].
            active: whether both feet stand; otherwise the offset only leaks.
        """
        velocity = self._gain * (measured - distributed)
        if not active:
            velocity = np.zeros(3)
        self.acceleration = (velocity - self.velocity) / self._dt
        self.velocity = velocity
        self.offset = self._integral.update(velocity)
