"""Settings of the two laws: the whole-body stabilizer's, and the ZMP baseline's.

What both have in common is in :mod:`surefoot.schemas.settings`.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from surefoot.schemas.robot_file import Fraction, NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct

Negative = Annotated[float, msgspec.Meta(lt=0.0)]
PositiveTriple = tuple[Positive, Positive, Positive]
PositiveSix = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
NegativeSix = tuple[Negative, Negative, Negative, Negative, Negative, Negative]
FractionSix = tuple[Fraction, Fraction, Fraction, Fraction, Fraction, Fraction]
CopAdmittance = Annotated[float, msgspec.Meta(ge=0.0, le=0.1)]
ComAdmittance = Annotated[float, msgspec.Meta(ge=0.0, le=20.0)]


class WholeBodySettings(FileStruct, frozen=True, kw_only=True):
    """Which law the whole-body stabilizer follows."""

    preset: Literal["surefoot", "paper"] = "surefoot"
    """``paper`` is the published law alone: no motion of the ground fed forward, feet
    that may tip, one posture weight for all joints. Settings given besides it win."""


class TsidSettings(FileStruct, frozen=True, kw_only=True):
    """First QP, inverse dynamics: which contact wrenches the feet should feel."""

    com_kp: PositiveTriple = (30.0, 30.0, 30.0)
    """CoM position gain, x y z [1/s^2]."""
    com_kd: PositiveTriple = (10.0, 10.0, 10.0)
    """CoM velocity gain, x y z [1/s]."""
    base_kp: Positive = 100.0
    """Base orientation gain [1/s^2]."""
    base_kd: Positive = 20.0
    """Base angular velocity gain [1/s]."""
    posture_kp: Positive = 50.0
    """Posture gain [1/s^2]."""
    posture_kd: Positive = 14.0
    """Joint velocity gain [1/s]."""
    com_weight: Positive = 1.0
    """Weight of the CoM's acceleration error, the scale of all others [1]."""
    base_weight: Positive = 0.1
    """Weight of the base's angular acceleration error [1]."""
    posture_weight: Positive = 1e-3
    """Weight of the joints above the legs [1]."""
    leg_posture_weight: NonNegative = 1e-6
    """Weight of the leg joints: the feet's ground moves them, so keep it small [1]."""
    torque_weight: Positive = 1e-6
    """Weight of |tau|^2 [(N m)^-2]."""
    force_weight: Positive = 1e-6
    """Weight of the force difference from an even load [N^-2]."""
    moment_weight: Positive = 1e-5
    """Weight of the sole moments [(N m)^-2]."""
    friction: Positive = 0.6
    """Friction coefficient assumed; keep it under the true one [1]."""
    yaw_friction: Positive = 0.05
    """Yaw moment per normal force [m]."""
    sole_scale: Fraction = 0.9
    """Part of the sole rectangle the centre of pressure may use [1]."""
    normal_force_min_n: NonNegative = 20.0
    """Least normal force of a foot in contact [N]."""
    normal_force_max_weights: Positive = 2.0
    """Largest normal force of a foot [body weights]."""


class DikSettings(FileStruct, frozen=True, kw_only=True):
    """Second QP, inverse kinematics: joint velocities that drive the wrenches there."""

    k_force: NegativeSix = (-50.0, -50.0, -50.0, -50.0, -50.0, -50.0)
    """Diagonal of K per foot, x y z roll pitch yaw, negative [1/s]. A wrench error
    moves the sole by Lambda_c^-1 / |K|: a smaller magnitude yields faster."""
    k_lag_s: Positive = 0.01
    """The servo profile's lag that doubles K while a foot does not stand firmly;
    while both do, the drives' inverse makes up for it [s]."""
    least_inverse: Fraction = 0.6
    """Part of the drives' inverse that is kept while a foot does not stand firmly, as
    on the way [1]."""
    loop_delay_s: NonNegative = 0.0
    """Delay of the loop that K is large enough for, from a reading to the servos that
    follow its answer; one tick of the robot at least [s]."""
    firm_again_s: Positive = 1.4
    """Time it takes to be as quick as with ideal drives again, after a foot that did
    not stand firmly [s]."""
    contact_weight: PositiveSix = (100.0, 100.0, 100.0, 100.0, 100.0, 100.0)
    """Weight of the wrench law per foot, x y z roll pitch yaw [1]."""
    yield_limit_m_s: Positive = 1.0
    """Fastest a sole yields to a force error."""
    yield_limit_rad_s: Positive = 6.0
    """Fastest a sole yields to a moment error."""
    com_gain: PositiveTriple = (2.0, 2.0, 2.0)
    """CoM position gain, x y z [1/s]."""
    com_weight: PositiveTriple = (10.0, 10.0, 10.0)
    """Weight of the CoM's velocity error, x y z [1]."""
    base_gain: Positive = 2.0
    """Base orientation gain [1/s]."""
    base_weight: Positive = 2.0
    """Weight of the base's angular velocity error [1]."""
    posture_gain: Positive = 1.0
    """Pull of the commanded posture to the reference posture [1/s]."""
    posture_weight: Positive = 1e-2
    """Weight of the joints above the legs [1]."""
    leg_posture_weight: NonNegative = 1e-3
    """Weight of the leg joints: the feet's ground moves them, so keep it small [1]."""
    regularisation: Positive = 1e-4
    """Weight of |v|^2, which keeps the problem solvable [1]."""
    velocity_limit_rad_s: Positive = 6.0
    """Fastest joint command; the robot file may be stricter."""
    limit_time_s: Positive = 0.02
    """Velocity damper: a joint may close the gap to its limit in no less [s]."""
    limit_margin_rad: NonNegative = 0.01
    """Margin to the joint limits."""
    stance_leak: NonNegative = 0.3
    """Pull of the feet back to the stance along the sole and about z [1/s]."""
    keep_flat: Fraction = 1.0
    """How far a foot whose pressure is wanted at its edge is kept from tipping over
    that edge [1]: 0 not at all, 1 wholly."""
    windup_limit_rad: Positive = 0.2
    """Largest distance of a command from its measured joint."""
    ramp_in_s: Positive = 0.1
    """Commands fade in over this time after the start."""


class GroundSettings(FileStruct, frozen=True, kw_only=True):
    """Feed-forward of the ground's estimated motion; all zero is the paper."""

    gain: FractionSix = (0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    """Part of each foot's estimated twist fed forward, x y z roll pitch yaw [1]."""
    pull_gain: Fraction = 1.0
    """Part of the ground's acceleration along the level that the centre of mass is to
    go along with [1]."""
    cutoff_hz: Positive = 15.0
    """Low-pass of the estimated twist."""
    lead_s: NonNegative = 0.015
    """Lead that makes up for the low-pass and the damping of the servos [s]."""
    firm_force_n: Positive = 100.0
    """Feed-forward is whole above this normal force, or 0.3 of the robot's weight where
    that is less, and in proportion below [N]."""
    edge_begins: Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)] = 0.7
    """Rotations are fed forward whole while the centre of pressure keeps within this
    part of the sole, and not at all at its edge, over which the foot may tip [1]."""
    edge_recovery_s: Positive = 0.03
    """Time it takes to return after the pressure has left the edge [s]."""
    recovery_s: Positive = 0.2
    """Time it takes to return after a foot was unloaded [s]."""


class SwaySettings(FileStruct, frozen=True, kw_only=True):
    """Swaying with ground that tilts, as people do (whole-body); off with gain 0."""

    gain: NonNegative = 0.0
    """Lean of the CoM for each tilt of the ground, never farther than the soles bear:
    0 stands upright in space, people have 2 to 5. For hard ground: soft ground tilts
    more the farther the robot leans [1]."""
    frequency_hz: Positive = 0.5
    """Where tilts begin to be too fast to be followed."""
    damping: Positive = 0.5
    """Damping ratio there: less sways more at that frequency [1]."""
    upright_again_s: Positive = 6.0
    """Time constant with which the robot stands up again on a tilt that stays [s]."""


class ZmpSettings(FileStruct, frozen=True, kw_only=True):
    """DCM feedback, wrench distribution and foot admittance.

    Names follow lipm_walking_controller and mc_rtc; docs/zmp-baseline.md has the table.
    The defaults are tuned on training scenarios; the settings file ``zmp-stock`` has
    the published values and clamps. Joint limits, speed limit and anti-windup (section
    ``dik``), ``estimator`` and ``contact`` are shared with the whole-body controller.
    """

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
