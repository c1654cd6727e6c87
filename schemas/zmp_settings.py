"""Settings of the ZMP baseline.

Names follow lipm_walking_controller and mc_rtc; docs/zmp-baseline.md has the table.
The defaults are tuned on training scenarios; the settings file ``zmp-stock`` has the
published values and clamps. Joint limits, speed limit and anti-windup (section
``dik``), ``estimator`` and ``contact`` are shared with the whole-body controller.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from surefoot.schemas.robot_file import Fraction, NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct

CopAdmittance = Annotated[float, msgspec.Meta(ge=0.0, le=0.1)]
ComAdmittance = Annotated[float, msgspec.Meta(ge=0.0, le=20.0)]


class ZmpSettings(FileStruct, frozen=True, kw_only=True):
    """DCM feedback, wrench distribution and foot admittance."""

    dcm_prop_gain: Annotated[float, msgspec.Meta(ge=0.0, le=20.0)] = 5.0
    """Proportional gain on the DCM error [Hz]."""
    dcm_integral_gain: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 5.0
    """Gain on the averaged DCM error, which is in metres [Hz]."""
    dcm_deriv_gain: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.0
    """Gain on the DCM velocity error less its moving average [1]."""
    dcm_integrator_time_constant_s: Positive = 10.0
    """Time constant of the moving average that serves as integrator [s]."""
    max_average_dcm_error_m: Positive = 0.05
    """Largest averaged DCM error, per axis [m]."""
    dcm_derivator_time_constant_s: Positive = 1.0
    """Time constant of the stationary offset taken off the velocity error [s]."""
    dcm_bias: Literal["off", "bias", "filter"] = "off"
    """Kalman filter that separates a bias of the measured CoM from the DCM error:
    ``bias`` subtracts the bias, ``filter`` also uses the filtered DCM."""
    dcm_measure_error_std_m: Positive = 0.01
    """DCM bias filter: standard deviation of the measured DCM at a 5 ms period [m]."""
    zmp_measure_error_std_m: Positive = 0.05
    """DCM bias filter: standard deviation of the measured ZMP at a 5 ms period [m]."""
    bias_drift_per_second_std_m: Positive = 0.02
    """DCM bias filter: standard deviation of the drift per second, 5 ms period [m]."""
    bias_limit_m: NonNegative = 0.02
    """DCM bias filter: largest bias, per axis of the base [m]."""
    com_velocity_cutoff_period_s: Positive = 0.01
    """Cutoff period of the low-pass on the measured CoM velocity [s]."""
    friction: Positive = 0.6
    """Assumed friction coefficient; choose it below the true one [1]."""
    sole_scale: Fraction = 0.9
    """Part of the sole rectangle the centre of pressure may use [1]."""
    min_ds_pressure_n: NonNegative = 15.0
    """Least normal force desired of a foot in contact [N]."""
    net_wrench_weight: Positive = 1e4
    """Distribution QP: weight of the net wrench error [1]."""
    ankle_torque_weight: Positive = 100.0
    """Distribution QP: weight of the ankle torques [1]."""
    pressure_weight: Positive = 1.0
    """Distribution QP: weight of the load share error [1]."""
    cop_admittance: tuple[CopAdmittance, CopAdmittance] = (0.1, 0.1)
    """Foot damping control: rotation speed per moment error, for the centre of pressure
    along x (a moment about y) and along y [rad/s per N m]."""
    dfz_admittance: Annotated[float, msgspec.Meta(ge=0.0, le=5e-4)] = 0.0005
    """Foot force difference control: vertical speed difference of the feet per error of
    the force difference [m/s per N]."""
    dfz_damping: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    """Foot force difference control: return of the height difference to the
    stance [Hz]."""
    vdc_frequency: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.5
    """Vertical drift compensation: return of the mean foot height to the stance
    [Hz]."""
    max_fdc_velocity_rad_s: Annotated[float, msgspec.Meta(gt=0.0, le=3.0)] = 3.0
    """Foot damping control: fastest desired foot rotation, per axis [rad/s]."""
    max_vertical_velocity_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    """Fastest desired vertical foot motion [m/s]."""
    touchdown_admittance: Annotated[float, msgspec.Meta(ge=0.0, le=1e-2)] = 2e-4
    """Touchdown seeking: descent of a lifted foot per missing force [m/s per N]."""
    touchdown_force_n: Positive = 50.0
    """Touchdown seeking: normal force at which a lifted foot stops descending [N]."""
    com_admittance: tuple[ComAdmittance, ComAdmittance] = (0.5, 0.5)
    """ZMP compensation control: CoM speed per ZMP error, x y [1/s]."""
    max_com_offset_m: Positive = 0.05
    """ZMP compensation control: largest CoM offset, per axis [m]."""
    zmpcc_integrator_leak_rate: NonNegative = 0.1
    """ZMP compensation control: return of the CoM offset to zero [1/s]."""
    contact_damping: Positive = 300.0
    """Inverse kinematics: tracking of the desired foot velocity [1/s]."""
    contact_stiffness: NonNegative = 1.0
    """Inverse kinematics: return of the feet to their stance [1/s^2]; divided by the
    damping it is the leak rate of the foot poses."""
    com_weight: Positive = 100000.0
    """Inverse kinematics: weight of the CoM, against 1e4 of the feet and 10 of the
    posture, which opposes it [1]."""
    level_base: Fraction = 0.0
    """Desired base orientation: 0 that of the commanded feet, 1 upright [1]."""
    level_height: Fraction = 1.0
    """Desired CoM height: 0 constant over the feet, 1 constant in the world [1]."""
