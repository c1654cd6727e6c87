"""Controller settings: every gain, weight and limit, with its unit and effect.

The defaults are what every published figure was made with. A TOML file may give
any subset; ``--set tsid.com_kp=40`` overrides one. A single number stands for all
axes of a setting that has several.
"""

from __future__ import annotations

import difflib
import tomllib
from typing import Annotated, Any, Literal

import msgspec

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.robot_file import Fraction, NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct, convert
from surefoot.schemas.walk_settings import WalkSettings
from surefoot.schemas.zmp_settings import ZmpSettings

Negative = Annotated[float, msgspec.Meta(lt=0.0)]
PositiveTriple = tuple[Positive, Positive, Positive]
PositiveSix = tuple[Positive, Positive, Positive, Positive, Positive, Positive]
NegativeSix = tuple[Negative, Negative, Negative, Negative, Negative, Negative]
FractionSix = tuple[Fraction, Fraction, Fraction, Fraction, Fraction, Fraction]


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
    """Feed-forward is whole above this normal force, and in proportion below [N]."""
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


class EstimatorSettings(FileStruct, frozen=True, kw_only=True):
    """Base attitude, velocity and position from the robot's own sensors."""

    calibration_s: NonNegative = 0.3
    """At rest after the start: mean tilt and gyroscope bias are taken, the posture
    is held [s]."""
    still_rate_rad_s: Positive = 0.03
    """A rate that gravity's direction follows, and its change in the meantime, together
    above this, are ground that turns: only gravity's direction tells the bias then."""
    tilt_bandwidth: Positive = 0.5
    """Correction of roll and pitch by accelerometer and leg velocity [rad/s]."""
    gyro_bias_gain: NonNegative = 0.02
    """Learning of the gyroscope bias [1/s^2]."""
    yaw_gain: NonNegative = 1.0
    """Pull of the yaw to the stance [1/s]."""
    accel_bias_memory_s: Positive = 60.0
    """How long the comparison of accelerometer and feet is remembered, by which the
    accelerometer's horizontal bias is told from a lean [s]."""
    height_bandwidth: Positive = 0.5
    """Pull of the height to the legs' kinematics while the ground moves [rad/s]:
    below it the ground is taken to be level on average, above it the accelerometer
    decides."""
    height_damping: Positive = 0.15
    """Damping ratio of that pull; less damping lets less of the ground through [1]."""
    height_bias_pull: NonNegative = 0.07
    """How fast the vertical acceleration's bias follows while the ground moves; on
    still ground it does so in two seconds [rad/s]."""
    still_height_bandwidth: Positive = 2.5
    """The same pull while the ground stands still [rad/s]; its damping is 0.7."""
    still_speed_m_s: Positive = 0.01
    """Vertical ground speed that tells still from moving."""
    anchor_cutoff_hz: Positive = 5.0
    """Low-pass of the load share that places the anchor between the feet."""


class ContactSettings(FileStruct, frozen=True, kw_only=True):
    """When a foot counts as standing, and how it looks for the ground."""

    lost_below_n: NonNegative = 15.0
    """Normal force under which contact is lost [N]."""
    regained_above_n: Positive = 40.0
    """Normal force over which contact is back [N]."""
    lost_after_s: NonNegative = 0.005
    """Time under the threshold until contact is lost."""
    regained_after_s: NonNegative = 0.003
    """Time over the threshold until contact is back."""
    search_force_n: Positive = 80.0
    """Normal force a lifted foot reaches for [N]."""
    descent_limit_m_s: Positive = 0.4
    """Fastest search for the ground."""
    reload_s: Positive = 0.15
    """A foot just back takes its full share after this time."""
    stiffness_n_m: Positive = 1e7
    """How stiff one sole and its ground are along its normal, for the margins: hard
    ground by default; a rubber sole is far softer [N/m]."""

    def __post_init__(self) -> None:
        """Refuse thresholds in the wrong order."""
        lost, regained = self.lost_below_n, self.regained_above_n
        if lost >= regained:
            raise ValueError(
                f"`lost_below_n` is {lost:g}, expected less than `regained_above_n`, "
                f"{regained:g}"
            )
        if self.search_force_n <= regained:
            raise ValueError(
                f"`search_force_n` is {self.search_force_n:g}, expected more than "
                f"`regained_above_n`, {regained:g}; a lifted foot would stop short of "
                "the ground"
            )


class SafetySettings(FileStruct, frozen=True, kw_only=True):
    """Plausibility limits of the sensors, and when to stop balancing."""

    ft_lost: Literal["degrade", "hold"] = "degrade"
    """One ankle sensor lost: go on without its force terms, or hold the posture."""
    both_ft_lost: Literal["degrade", "hold"] = "hold"
    """The same for both of them."""
    bridge_s: Positive = 0.01
    """Time for which the last good reading bridges missing or impossible ones, until
    the sensor is lost [s]."""
    frozen_after_s: Positive = 0.02
    """Time of identical readings, while others move, until a sensor is lost [s]."""
    recover_s: Positive = 0.1
    """Time for which a lost ankle sensor must be good until it is used again [s]."""
    force_range_n: Positive = 12000.0
    """Largest force an ankle sensor can report, each axis [N]. A foot that hits ground
    coming up at it feels 5000 for some ms."""
    moment_range_nm: Positive = 1500.0
    """Largest moment an ankle sensor can report, each axis [N m]."""
    force_jump_n: Positive = 7000.0
    """Largest change of an ankle force in one tick, each axis [N]."""
    moment_jump_nm: Positive = 1000.0
    """Largest change of an ankle moment in one tick, each axis [N m]."""
    overload_n: Positive = 1500.0
    """Force above which a foot is overloaded: only an impact reaches it [N]."""
    overload_after_s: Positive = 0.03
    """Time above it after which the sensor is lost; impacts are over sooner [s]."""
    gyro_range_rad_s: Positive = 35.0
    """Largest rate of turn the IMU can report, each axis [rad/s]."""
    accel_range_m_s2: Positive = 300.0
    """Largest specific force it can report, each axis [m/s^2]."""
    gyro_jump_rad_s: Positive = 4.0
    """Largest change of the rate of turn in one tick, each axis [rad/s]."""
    accel_jump_m_s2: Positive = 200.0
    """Largest change of the specific force in one tick, each axis [m/s^2]."""
    joint_margin_rad: Positive = 0.2
    """Distance outside its range beyond which a joint reading is impossible [rad]."""
    joint_jump_rad: Positive = 0.1
    """Largest change of any joint in one tick [rad]."""
    tilt_limit_rad: Positive = 0.8
    """Tilt from the start beyond which the robot has fallen [rad]."""
    unloaded_n: Positive = 30.0
    """Load of both feet together below which they carry nothing [N]."""
    unloaded_after_s: Positive = 1.0
    """Time without load on the feet after which the robot has fallen [s]."""
    ramp_out_s: Positive = 0.05
    """With a sensor lost or after a fall, the last motion fades out over this time
    before the posture is held [s]."""
    leave_s: Annotated[float, msgspec.Meta(ge=0.0, le=5.0)] = 0.05
    """Asked to stop, the controller balances on for this long, with less and less
    motion, before the posture is held; 0 to hold at once [s]."""

    def __post_init__(self) -> None:
        """Refuse forces in the wrong order."""
        if not self.unloaded_n < self.overload_n < self.force_range_n:
            raise ValueError(
                f"`unloaded_n`, `overload_n` and `force_range_n` are "
                f"{self.unloaded_n:g}, {self.overload_n:g} and "
                f"{self.force_range_n:g}, expected them to rise in this order"
            )


class WholeBodySettings(FileStruct, frozen=True, kw_only=True):
    """Which law the whole-body stabilizer follows."""

    preset: Literal["surefoot", "paper"] = "surefoot"
    """``paper`` is the published law alone: no motion of the ground fed forward, feet
    that may tip, one posture weight for all joints. Settings given besides it win."""


class ControllerSettings(FileStruct, frozen=True, kw_only=True):
    """All settings of all controllers."""

    whole_body: WholeBodySettings = WholeBodySettings()
    """Which law the whole-body stabilizer follows."""
    tsid: TsidSettings = TsidSettings()
    """First QP."""
    dik: DikSettings = DikSettings()
    """Second QP."""
    ground: GroundSettings = GroundSettings()
    """Feed-forward of the ground's motion."""
    sway: SwaySettings = SwaySettings()
    """Swaying with ground that tilts."""
    estimator: EstimatorSettings = EstimatorSettings()
    """Estimator."""
    contact: ContactSettings = ContactSettings()
    """Contact of the feet."""
    safety: SafetySettings = SafetySettings()
    """Plausibility of sensors, stopping and falling."""
    zmp: ZmpSettings = ZmpSettings()
    """The ZMP baseline."""
    walk: WalkSettings = WalkSettings()
    """Steps of the whole-body stabilizer."""


PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    "surefoot": {},
    "paper": {
        "ground": {"gain": 0.0, "pull_gain": 0.0},
        "tsid": {"leg_posture_weight": TsidSettings().posture_weight},
        "dik": {
            "leg_posture_weight": DikSettings().posture_weight,
            "keep_flat": 0.0,
        },
    },
}
"""What each preset sets, where neither file nor command line says otherwise."""


def build_settings(
    table: dict[str, Any], *, overrides: list[str], source: str = "settings"
) -> ControllerSettings:
    """Join defaults, a settings table and command-line overrides.

    Args:
        table: content of a settings file; empty for the defaults.
        overrides: texts ``section.name=value``, the value written as in TOML.
        source: named in errors about the table.

    Raises:
        FileFormatError: unknown key (with the nearest valid one), wrong type, or
            a value out of range.
    """
    merged = {
        section: dict(values) if isinstance(values, dict) else values
        for section, values in table.items()
    }
    known = setting_names()
    for text in overrides:
        key, value = _parse_override(text, known)
        section, name = key.split(".", 1)
        part = merged.setdefault(section, {})
        if not isinstance(part, dict):
            raise FileFormatError(
                f"{source}: {section}: got {part!r}, expected a table", field=section
            )
        part[name] = value
    if overrides:
        source = f"{source} with --set" if table else "--set"
    table = _spread(_with_preset(merged), source=source)
    return convert(table, ControllerSettings, source=source)


def _with_preset(table: dict[str, Any]) -> dict[str, Any]:
    """Lay the table over the values of the preset that it names."""
    choice = table.get("whole_body")
    name = choice.get("preset") if isinstance(choice, dict) else None
    for section, values in PRESETS.get(str(name), {}).items():
        part = table.setdefault(section, {})
        if isinstance(part, dict):
            table[section] = {**values, **part}
    return table


def _spread(table: dict[str, Any], *, source: str) -> dict[str, Any]:
    """Repeat a single number for all axes of a setting."""
    for section in msgspec.structs.fields(ControllerSettings):
        part = table.get(section.name)
        if not isinstance(part, dict):
            continue
        for field in msgspec.structs.fields(section.type):
            value = part.get(field.name)
            if value is None or not isinstance(field.default, tuple):
                continue
            count, name = len(field.default), f"{section.name}.{field.name}"
            if isinstance(value, (int, float)) and not isinstance(value, bool):
                part[field.name] = [value] * count
            elif not isinstance(value, (list, tuple)):
                raise FileFormatError(
                    f"{source}: {name}: got {value!r}, expected a number, or a list "
                    f"of {count}",
                    field=name,
                )
    return table


def setting_names() -> list[str]:
    """Return all settable names, as ``section.name``."""
    return [
        f"{section.name}.{field.name}"
        for section in msgspec.structs.fields(ControllerSettings)
        for field in msgspec.structs.fields(section.type)
    ]


def _parse_override(text: str, known: list[str]) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals:
        raise FileFormatError(
            f"--set {text!r}: expected KEY=VALUE, such as tsid.base_kp=120", field=key
        )
    if key not in known:
        hint = _near_settings(key, known)
        raise FileFormatError(f"--set {key}: no such setting; {hint}", field=key)
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value.strip()


def _near_settings(key: str, known: list[str]) -> str:
    """Return the nearest setting, else those of the section, else the sections."""
    near = difflib.get_close_matches(key, known, n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    section = key.split(".")[0]
    inside = [name for name in known if name.startswith(f"{section}.")]
    if inside:
        return f"{section} has {', '.join(inside)}"
    sections = dict.fromkeys(name.split(".")[0] for name in known)
    return f"settings are SECTION.NAME, with sections {', '.join(sections)}"
