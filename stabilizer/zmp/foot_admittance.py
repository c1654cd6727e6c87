"""Foot admittance: how the commanded soles should move, given what they feel.

Velocities are for the commanded robot's soles. A foot whose centre of pressure is too
far forward lifts its toe; one that is too far left lifts its left edge; a foot that
carries more than its share goes up against the other one. All of them yield.
"""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.zmp_settings import ZmpSettings
from surefoot.stabilizer.dynamics import NORMAL
from surefoot.stabilizer.zmp.dcm_feedback import LeakyIntegrator
from surefoot.stabilizer.zmp.distribution import centre_of_pressure


class FootAdmittance:
    """Wanted sole twists of the commanded robot.

    Attributes:
        twist: (12,) of left and right sole, commanded sole frames.
    """

    def __init__(self, settings: ZmpSettings) -> None:
        """Keep the gains."""
        self._settings = settings
        self.twist: Array = np.zeros(12)

    def update(
        self,
        *,
        F_meas: Array,
        F_wanted: Array,
        in_contact: list[bool],
        R_measured: list[Mat],
        R_commanded: list[Mat],
        p_commanded: list[Vec3],
        p_stance: list[Vec3],
    ) -> Array:
        """Compute the twists of this tick.

        Args:
            F_meas: (12,) measured wrenches of the ground on the soles.
            F_wanted: (12,) wanted ones.
            in_contact: which feet stand.
            R_measured: rotations of the soles as measured.
            R_commanded: rotations of the commanded soles.
            p_commanded: (3,) positions of the commanded soles [m].
            p_stance: (3,) where they belong [m].

        Returns:
            (12,) twists, reused by the next call.
        """
        self.twist[:] = 0.0
        speeds = self.vertical_speeds(
            F_meas=F_meas,
            F_wanted=F_wanted,
            in_contact=in_contact,
            R_measured=R_measured,
            heights=(p_commanded[0].item(2), p_commanded[1].item(2)),
            stance_heights=(p_stance[0].item(2), p_stance[1].item(2)),
        )
        for side in (0, 1):
            rows = slice(6 * side, 6 * side + 6)
            if in_contact[side]:
                self.twist[6 * side + 3 : 6 * side + 5] = self.rotation(
                    F_meas[rows], F_wanted[rows]
                )
            # World's vertical, in the commanded sole frame.
            self.twist[6 * side : 6 * side + 3] = speeds[side] * R_commanded[side][2]
        return self.twist

    def rotation(self, F_meas: Array, F_wanted: Array) -> tuple[float, float]:
        """Foot damping control: rotation about x and y of one sole [rad/s].

        The wanted moment is that of the wanted centre of pressure under the measured
        normal force, so a load error does not turn the foot.

        Args:
            F_meas: (6,) measured wrench, sole frame.
            F_wanted: (6,) wanted wrench, sole frame.
        """
        settings = self._settings
        cop_x, cop_y = centre_of_pressure(F_wanted)
        normal = max(F_meas.item(NORMAL), 0.0)
        error_x = F_meas.item(3) - cop_y * normal
        error_y = F_meas.item(4) + cop_x * normal
        # A moment about x moves the centre of pressure along y.
        along_x, along_y = settings.cop_admittance
        limit = settings.rotation_limit_rad_s
        return _clamp(along_y * error_x, limit), _clamp(along_x * error_y, limit)

    def vertical_speeds(
        self,
        *,
        F_meas: Array,
        F_wanted: Array,
        in_contact: list[bool],
        R_measured: list[Mat],
        heights: tuple[float, float],
        stance_heights: tuple[float, float],
    ) -> tuple[float, float]:
        """Force difference, drift compensation and search: speeds [m/s], world up.

        Args:
            F_meas: (12,) measured wrenches.
            F_wanted: (12,) wanted ones.
            in_contact: which feet stand.
            R_measured: rotations of the soles as measured.
            heights: of the commanded soles [m].
            stance_heights: where they belong [m].
        """
        settings = self._settings
        if not (in_contact[0] and in_contact[1]):
            return self._seek(0, F_meas, in_contact), self._seek(1, F_meas, in_contact)
        up_left, up_right = R_measured[0][2], R_measured[1][2]
        wanted = float(up_left @ F_wanted[:3] - up_right @ F_wanted[6:9])
        felt = float(up_left @ F_meas[:3] - up_right @ F_meas[6:9])
        height_error = (stance_heights[0] - stance_heights[1]) - (
            heights[0] - heights[1]
        )
        parting = settings.force_admittance * (wanted - felt)
        parting -= settings.height_stiffness * height_error
        drift = sum(stance_heights) - sum(heights)
        common = settings.drift_hz * drift
        limit = settings.lift_limit_m_s
        return (
            _clamp(0.5 * (common - parting), limit),
            _clamp(0.5 * (common + parting), limit),
        )

    def _seek(self, side: int, F_meas: Array, in_contact: list[bool]) -> float:
        """A lifted foot goes down while the other one stands; in the air none does."""
        other_stands = in_contact[1 - side]
        if in_contact[side] or not other_stands:
            return 0.0
        settings = self._settings
        missing = settings.seek_force_n - F_meas.item(6 * side + NORMAL)
        return -_clamp(settings.seek_admittance * missing, settings.lift_limit_m_s)


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


class ComAdmittance:
    """Offset of the CoM reference from the ZMP error.

    The CoM moves towards where the measured ZMP exceeds the distributed one:
    cd = -A (z_distributed - z_measured).

    Attributes:
        offset: (3,) [m].
        velocity: (3,) [m/s].
        acceleration: (3,) [m/s^2].
    """

    def __init__(self, settings: ZmpSettings, *, period_s: float) -> None:
        """Begin without offset."""
        self._gain = np.array([*settings.com_admittance, 0.0])
        self._dt = period_s
        self._integral = LeakyIntegrator(
            leak=settings.com_offset_leak,
            limit=settings.com_offset_limit_m,
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
