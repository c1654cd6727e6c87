"""Settings of the two control laws: whole-body stabilizer and ZMP baseline.

Settings that both share are in :mod:`surefoot.schemas.settings`.
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
    """Variant of the whole-body stabilizer's law."""

    preset: Literal["surefoot", "paper"] = "surefoot"
    """``paper`` is the published law alone: no feed-forward of ground motion, feet may
    tip, one posture weight for all joints. Settings that are given override it."""


class TsidSettings(FileStruct, frozen=True, kw_only=True):
    """First QP, task-space inverse dynamics (TSID): the desired contact wrenches."""

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
    """Weight of the CoM's acceleration error, the scale of all other weights [1]."""
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
    """Assumed friction coefficient; choose it below the true one [1]."""
    yaw_friction: Positive = 0.05
    """Largest yaw moment per normal force [m]."""
    sole_scale: Fraction = 0.9
    """Part of the sole rectangle the centre of pressure may use [1]."""
    normal_force_min_n: NonNegative = 20.0
    """Least normal force of a foot in contact [N]."""
    normal_force_max_weights: Positive = 2.0
    """Largest normal force of a foot [body weights]."""


class DikSettings(FileStruct, frozen=True, kw_only=True):
    """Second QP, inverse kinematics (DIK): joint velocities that drive the wrenches."""

    k_force: NegativeSix = (-50.0, -50.0, -50.0, -50.0, -50.0, -50.0)
    """Diagonal of K per foot, x y z roll pitch yaw, negative [1/s]. A wrench error
    moves the sole by Lambda_c^-1 / |K|: a smaller magnitude yields faster."""
    k_lag_s: Positive = 0.01
    """Servo lag at which K is doubled while a foot does not stand firmly. While both
    feet do, the inverse of the drives compensates the lag instead [s]."""
    least_inverse: Fraction = 0.6
    """Part of the drives' inverse that is kept while a foot does not stand firmly, as
    in walking [1]."""
    loop_delay_s: NonNegative = 0.0
    """Loop delay for which K is made large enough, from a sensor reading to the servos
    that follow its answer. Values below one tick of the robot count as one tick [s]."""
    firm_again_s: Positive = 1.4
    """Time in which K and the drives' inverse become those of a firm stand again, after
    a foot did not stand firmly [s]."""
    contact_weight: PositiveSix = (100.0, 100.0, 100.0, 100.0, 100.0, 100.0)
    """Weight of the wrench law per foot, x y z roll pitch yaw [1]."""
    yield_limit_m_s: Positive = 1.0
    """Largest speed at which a sole yields to a force error."""
    yield_limit_rad_s: Positive = 6.0
    """Largest angular speed at which a sole yields to a moment error."""
    com_gain: PositiveTriple = (2.0, 2.0, 2.0)
    """CoM position gain, x y z [1/s]."""
    com_weight: PositiveTriple = (10.0, 10.0, 10.0)
    """Weight of the CoM's velocity error, x y z [1]."""
    base_gain: Positive = 2.0
    """Base orientation gain [1/s]."""
    base_weight: Positive = 2.0
    """Weight of the base's angular velocity error [1]."""
    posture_gain: Positive = 1.0
    """Gain that pulls the commanded posture to the reference posture [1/s]."""
    posture_weight: Positive = 1e-2
    """Weight of the joints above the legs [1]."""
    leg_posture_weight: NonNegative = 1e-3
    """Weight of the leg joints: the feet's ground moves them, so keep it small [1]."""
    regularisation: Positive = 1e-4
    """Weight of |v|^2, which keeps the problem solvable [1]."""
    velocity_limit_rad_s: Positive = 6.0
    """Largest commanded joint velocity; the robot file may be stricter."""
    limit_time_s: Positive = 0.02
    """Velocity damper: least time for a joint to close the gap to its limit [s]."""
    limit_margin_rad: NonNegative = 0.01
    """Distance kept to the joint limits."""
    stance_leak: NonNegative = 0.3
    """Gain that pulls the feet back to the stance, along the sole and about z [1/s]."""
    keep_flat: Fraction = 1.0
    """Holding back a foot that would tip over its edge while pressure is desired at
    that edge: 0 not at all, 1 wholly [1]."""
    windup_limit_rad: Positive = 0.2
    """Largest distance of a joint command from the measured position."""
    ramp_in_s: Positive = 0.1
    """Commands fade in over this time after the start."""


class GroundSettings(FileStruct, frozen=True, kw_only=True):
    """Feed-forward of the ground's estimated motion; the paper has all gains zero."""

    gain: FractionSix = (0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    """Part of each foot's estimated twist fed forward, x y z roll pitch yaw [1]."""
    pull_gain: Fraction = 1.0
    """Part of the ground's horizontal acceleration that the CoM follows [1]."""
    cutoff_hz: Positive = 15.0
    """Cutoff frequency of the low-pass on the estimated twist."""
    lead_s: NonNegative = 0.015
    """Lead that compensates the low-pass and the damping of the servos [s]."""
    firm_force_n: Positive = 100.0
    """Normal force above which the feed-forward is complete, or 0.3 of the robot's
    weight if that is less; below, it shrinks in proportion [N]."""
    edge_begins: Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)] = 0.7
    """Part of the sole within which the centre of pressure must be for complete
    feed-forward of rotations. At the edge, where the foot may tip, there is none
    [1]."""
    edge_recovery_s: Positive = 0.03
    """Time in which it is complete again after the pressure has left the edge [s]."""
    recovery_s: Positive = 0.2
    """Time in which the feed-forward returns after a foot was unloaded [s]."""


class SwaySettings(FileStruct, frozen=True, kw_only=True):
    """Sway with tilting ground, as people do (whole-body controller); 0 gain: off."""

    gain: NonNegative = 0.0
    """Lean of the CoM per tilt of the ground, limited to what the soles bear: 0 stands
    upright in space, people have 2 to 5. Meant for hard ground: soft ground tilts more,
    the farther the robot leans [1]."""
    frequency_hz: Positive = 0.5
    """Frequency above which tilts are too fast to be followed."""
    damping: Positive = 0.5
    """Damping ratio at that frequency: less damping sways more there [1]."""
    upright_again_s: Positive = 6.0
    """Time constant with which the robot stands up again on a tilt that stays [s]."""


class ZmpSettings(FileStruct, frozen=True, kw_only=True):
    """DCM feedback, wrench distribution and foot admittance.

    Names follow lipm_walking_controller and mc_rtc; docs/zmp-baseline.md has the table.
    The defaults are tuned on training scenarios; the settings file ``zmp-stock`` has
    the published values and clamps. The joint limits, the speed limit and the
    anti-windup of section ``dik`` apply here too, as do ``estimator`` and ``contact``.
    """

    dcm_prop_gain: Annotated[float, msgspec.Meta(ge=0.0, le=20.0)] = 5.0
    """Proportional gain on the DCM error [Hz]."""
    dcm_integral_gain: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 5.0
    """Gain on the averaged DCM error (in metres) [Hz]."""
    dcm_deriv_gain: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.0
    """Gain on the DCM velocity error minus its moving average [1]."""
    dcm_integrator_time_constant_s: Positive = 10.0
    """Time constant of the moving average that serves as integrator [s]."""
    max_average_dcm_error_m: Positive = 0.05
    """Largest averaged DCM error, per axis [m]."""
    dcm_derivator_time_constant_s: Positive = 1.0
    """Time constant of the average taken off the DCM velocity error [s]."""
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
    """Least desired normal force of a foot in contact [N]."""
    net_wrench_weight: Positive = 1e4
    """Distribution QP: weight of the net wrench error [1]."""
    ankle_torque_weight: Positive = 100.0
    """Distribution QP: weight of the ankle torques [1]."""
    pressure_weight: Positive = 1.0
    """Distribution QP: weight of the load share error [1]."""
    cop_admittance: tuple[CopAdmittance, CopAdmittance] = (0.1, 0.1)
    """Foot damping control: angular speed per moment error, for the centre of pressure
    along x (a moment about y) and along y [rad/s per N m]."""
    dfz_admittance: Annotated[float, msgspec.Meta(ge=0.0, le=5e-4)] = 0.0005
    """Foot force difference control: vertical speed difference of the feet per error of
    the force difference [m/s per N]."""
    dfz_damping: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    """Foot force difference control: rate at which the height difference returns to the
    stance [Hz]."""
    vdc_frequency: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.5
    """Vertical drift compensation: rate at which the mean foot height returns to the
    stance [Hz]."""
    max_fdc_velocity_rad_s: Annotated[float, msgspec.Meta(gt=0.0, le=3.0)] = 3.0
    """Foot damping control: fastest desired foot rotation, per axis [rad/s]."""
    max_vertical_velocity_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    """Fastest desired vertical foot motion [m/s]."""
    touchdown_admittance: Annotated[float, msgspec.Meta(ge=0.0, le=1e-2)] = 2e-4
    """Touchdown seeking: speed of a lifted foot per missing force [m/s per N]."""
    touchdown_force_n: Positive = 50.0
    """Touchdown seeking: normal force at which a lifted foot stops descending [N]."""
    com_admittance: tuple[ComAdmittance, ComAdmittance] = (0.5, 0.5)
    """ZMP compensation control: CoM speed per ZMP error, x y [1/s]."""
    max_com_offset_m: Positive = 0.05
    """ZMP compensation control: largest CoM offset, per axis [m]."""
    zmpcc_integrator_leak_rate: NonNegative = 0.1
    """ZMP compensation control: rate at which the CoM offset returns to zero [1/s]."""
    contact_damping: Positive = 300.0
    """Inverse kinematics: gain on the error of the foot velocity [1/s]."""
    contact_stiffness: NonNegative = 1.0
    """Inverse kinematics: stiffness of the feet's return to their stance. Divided by
    the damping it is the leak rate of the foot poses [1/s^2]."""
    com_weight: Positive = 100000.0
    """Inverse kinematics: weight of the CoM. The feet have 1e4; the posture, which
    opposes it, has 10 [1]."""
    level_base: Fraction = 0.0
    """Desired base orientation: 0 follows the commanded feet, 1 is upright [1]."""
    level_height: Fraction = 1.0
    """Desired CoM height: 0 constant over the feet, 1 constant in the world [1]."""
