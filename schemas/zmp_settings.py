"""Settings of the ZMP baseline, the rival of the whole-body controller.

The defaults are the tuned ones, the baseline's own best on training scenarios. The
published values and clamps are the settings file ``zmp-stock``. Joint limits, speed
limit and anti-windup are shared with the other controller (section ``dik``), and so
are ``estimator`` and ``contact``.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from surefoot.schemas.robot_file import NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct

Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
CopAdmittance = Annotated[float, msgspec.Meta(ge=0.0, le=0.1)]
ComAdmittance = Annotated[float, msgspec.Meta(ge=0.0, le=20.0)]


class ZmpSettings(FileStruct, frozen=True, kw_only=True):
    """DCM feedback, wrench distribution and foot admittance."""

    dcm_kp: Annotated[float, msgspec.Meta(ge=0.0, le=20.0)] = 5.0
    """Gain of the DCM error [Hz]."""
    dcm_ki: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 5.0
    """Gain of the averaged DCM error, which is in metres [Hz]."""
    dcm_kd: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.0
    """Gain of the DCM's velocity error less its average [1]."""
    dcm_average_s: Positive = 10.0
    """Time constant of the average that acts as integrator [s]."""
    dcm_average_limit_m: Positive = 0.05
    """Largest average, per axis [m]."""
    dcm_derivator_s: Positive = 1.0
    """Time constant of the offset removed from the velocity error [s]."""
    dcm_bias: Literal["off", "bias", "filter"] = "off"
    """Kalman filter that tells a bias of the measured centre of mass from an error:
    ``bias`` takes the bias off the DCM error, ``filter`` uses the filtered DCM too."""
    dcm_bias_dcm_std_m: Positive = 0.01
    """Its standard deviation of the measured DCM, for a period of 5 ms [m]."""
    dcm_bias_zmp_std_m: Positive = 0.05
    """Its standard deviation of the measured ZMP, for a period of 5 ms [m]."""
    dcm_bias_drift_m_s: Positive = 0.02
    """Its standard deviation of the bias's drift, for a period of 5 ms [m/s]."""
    dcm_bias_limit_m: NonNegative = 0.02
    """Largest bias, per axis of the base [m]."""
    com_velocity_lag_s: Positive = 0.01
    """Low-pass of the measured CoM velocity [s]."""
    friction: Positive = 0.6
    """Friction coefficient assumed; keep it under the true one [1]."""
    sole_scale: Fraction = 0.9
    """Part of the sole rectangle the centre of pressure may use [1]."""
    normal_force_min_n: NonNegative = 15.0
    """Least normal force asked of a foot in contact [N]."""
    net_weight: Positive = 1e4
    """Distribution: weight of the net wrench's error [1]."""
    ankle_weight: Positive = 100.0
    """Distribution: weight of the ankles' torques [1]."""
    share_weight: Positive = 1.0
    """Distribution: weight of the load share's error [1]."""
    cop_admittance: tuple[CopAdmittance, CopAdmittance] = (0.1, 0.1)
    """Foot rotation per error of the centre of pressure along x (a torque about y)
    and along y [rad/s per N m]."""
    force_admittance: Annotated[float, msgspec.Meta(ge=0.0, le=5e-4)] = 0.0005
    """Difference of the feet's vertical speeds per force difference [m/s per N]."""
    height_stiffness: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    """Pull of the feet's height difference to the stance's [Hz]."""
    drift_hz: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.5
    """Pull of the feet's mean height to the stance's [Hz]."""
    rotation_limit_rad_s: Annotated[float, msgspec.Meta(gt=0.0, le=3.0)] = 3.0
    """Fastest foot rotation asked, per axis [rad/s]."""
    lift_limit_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    """Fastest vertical foot motion asked [m/s]."""
    seek_admittance: Annotated[float, msgspec.Meta(ge=0.0, le=1e-2)] = 2e-4
    """Descent of a lifted foot per missing force [m/s per N]."""
    seek_force_n: Positive = 50.0
    """Normal force a lifted foot reaches for [N]."""
    com_admittance: tuple[ComAdmittance, ComAdmittance] = (0.5, 0.5)
    """CoM speed per error of the ZMP, x y [1/s]."""
    com_offset_limit_m: Positive = 0.05
    """Largest CoM offset of the CoM admittance, per axis [m]."""
    com_offset_leak: NonNegative = 0.1
    """Return of that offset [1/s]."""
    contact_damping: Positive = 300.0
    """How soon the feet take up the speed asked [1/s]."""
    contact_stiffness: NonNegative = 1.0
    """Pull of the feet to their stance [1/s^2]; divided by the damping it is the
    leak of the foot poses."""
    com_weight: Positive = 100000.0
    """Inverse kinematics: weight of the CoM, against 1e4 of the feet and 10 of the
    posture, which holds the CoM back [1]."""
    level_base: Fraction = 0.0
    """Base orientation wanted: 0 that of the commanded feet, 1 upright [1]."""
    level_height: Fraction = 1.0
    """CoM height wanted: 0 constant over the feet, 1 constant in the world [1]."""
