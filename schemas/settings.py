"""Controller settings: every gain, weight and limit, with its unit and effect.

The defaults are what every published figure was made with. A TOML file may give
any subset; ``--set tsid.com_kp=40`` overrides one. A single number stands for all
axes of a setting that has several.
"""

from __future__ import annotations

import difflib
from typing import Annotated, Any, Literal

import msgspec

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.law_settings import (
    DikSettings,
    GroundSettings,
    SwaySettings,
    TsidSettings,
    WholeBodySettings,
    ZmpSettings,
)
from surefoot.schemas.robot_file import Fraction, NonNegative, Positive
from surefoot.schemas.toml_file import FileStruct, convert, parse_override

Share = Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]


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
    """Normal force a lifted foot reaches for; 0.115 of the robot's weight where that is
    more [N]."""
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
    """Force above which a foot is overloaded: only an impact reaches it. Never less
    than two of the robot's weights, which a foot may be asked to carry [N]."""
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


class WalkSettings(FileStruct, frozen=True, kw_only=True):
    """How the steps of a plan are taken, by any controller that walks."""

    shift_s: Positive = 0.8
    """First shift of the weight onto one foot, from standing."""
    settle_s: Positive = 0.6
    """Last shift of the weight, back between the feet."""
    preview_steps: Annotated[int, msgspec.Meta(ge=1, le=10)] = 3
    """Steps ahead that the reference of the DCM looks [1]."""
    horizontal_part: Share = 0.85
    """Part of single support in which the swing foot travels [1]."""
    apex_part: Share = 0.45
    """Part of single support after which it is highest [1]."""
    touchdown_m_s: Positive = 0.05
    """Speed towards the expected ground at the planned touchdown."""
    late_m_s: Positive = 0.3
    """Speed down where the ground was expected and is not."""
    late_depth_m: Positive = 0.12
    """Farthest that a foot goes down below the expected ground [m]."""
    unloaded_share: Fraction = 0.13
    """A foot may leave the ground when it carries less of the weight [1]."""
    unload_wait_s: NonNegative = 0.1
    """It leaves without having unloaded after so long."""
    touchdown_n: Positive = 40.0
    """Normal force at which a foot in the air has touched down [N]."""
    caught_share: Positive = 0.1
    """A foot in the air that meets more than this part of the weight on its way, and
    less from below, is caught at an edge [1]."""
    step_over_m: NonNegative = 0.03
    """So much higher than planned it then goes on; 0 has it push on [m]."""
    landing_s: Positive = 0.12
    """After touchdown a foot is landing for so long."""
    landing_force_n: Positive = 250.0
    """Largest normal force error that a landing foot yields to [N]."""
    bounce_n: NonNegative = 15.0
    """A landing foot that feels less has bounced [N]."""
    bounce_s: NonNegative = 0.012
    """And for so long."""
    anchor_s: NonNegative = 0.05
    """The odometry follows a foot until so long after its touchdown."""
    early_share: Fraction = 0.08
    """Part of the weight asked of a foot that touched down early [1]."""
    leaving_margin: Fraction = 0.15
    """How much more than its planned part of the weight a leaving foot may be asked
    to carry [1]."""
    lead_s: NonNegative = 0.005
    """Lead of the swing foot's velocity, beside the servos' own lag [s]."""
    swing_gain: Positive = 12.0
    """Second QP: position and orientation gain of the swing foot [1/s]."""
    swing_kp: Positive = 100.0
    """First QP: position gain of the swing foot [1/s^2]."""
    swing_kd: Positive = 20.0
    """First QP: velocity gain of the swing foot [1/s]."""
    swing_weight: Positive = 0.3
    """First QP: weight of the swing foot, where the centre of mass has 1 [1]."""
    height_s: Positive = 1.5
    """Time constant with which the height reference follows the feet [s]."""
    climb_s: Positive = 0.15
    """The same to heights of the plan: of each of three low-passes [s]."""
    normal_filter_s: Positive = 0.03
    """Low-pass of the expected ground's normal [s]."""
    normal_agreement: Positive = 0.06
    """Soles whose normals, or the line between them, disagree by more than this show
    no common ground [rad]."""
    adjust: Literal["off", "place", "both"] = "both"
    """Whether a step changes its place, or place and time, when the DCM leaves its
    reference."""
    adjust_dead_m: tuple[NonNegative, NonNegative] = (0.02, 0.015)
    """Error of the DCM, ahead and sideways, that changes no step [m]."""
    adjust_filter_s: Positive = 0.03
    """Low-pass of that error: impacts shake it [s]."""
    adjust_growth_m: Positive = 0.13
    """A step that lasts so long that the DCM gets twice as far counts as much as one
    that is shifted by this [m]."""
    adjust_offset_weight: Positive = 5.0
    """How much a DCM off its place at the end of the step counts more than a step off
    its own [1]."""
    adjust_zmp_share: Fraction = 0.5
    """Part of the sole in which the ZMP is taken to answer an error of the DCM; over
    the outer edge of the standing foot all of it [1]."""
    adjust_wait_s: NonNegative = 0.3
    """Longest that single support is made longer."""
    adjust_pause_m: Positive = 0.05
    """No foot leaves the ground while the DCM is farther off its reference [m]."""
    adjust_pause_s: NonNegative = 0.8
    """But each is kept no longer than this."""
    adjust_rate_m_s: Positive = 2.0
    """Fastest shift of a step."""
    adjust_limit_m: tuple[Positive, Positive] = (0.25, 0.20)
    """Largest shift of a step, ahead and sideways [m]."""
    adjust_until_s: NonNegative = 0.05
    """No other shift so long before the planned touchdown."""
    cross_ahead_m: NonNegative = 0.42
    """How far ahead of the standing foot, or behind it, the other one passes on a step
    that crosses, lest the legs meet; 0, or more than `longest_m`: feet do not cross
    [m]."""
    between_soles_m: NonNegative = 0.015
    """Least gap between the soles, sideways [m]."""
    farthest_m: Positive = 0.45
    """Largest sideways distance of the middles of the feet [m]."""
    longest_m: Positive = 0.5
    """Farthest that a foot may be set ahead of, or behind, the other [m]."""
    turn_limit_rad: Positive = 0.6
    """Largest turn of a foot against the other [rad]."""
    rise_limit_m: Positive = 0.2
    """Largest difference of height between two footholds [m]."""


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
        key, value = parse_override(text, option="--set", example="tsid.base_kp=120")
        if key not in known:
            hint = _near_settings(key, known)
            raise FileFormatError(f"--set {key}: no such setting; {hint}", field=key)
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


def setting_of(settings: ControllerSettings, name: str) -> Any:
    """Return the value of a setting, by its ``section.name``."""
    section, key = name.split(".")
    return getattr(getattr(settings, section), key)


def setting_names() -> list[str]:
    """Return all settable names, as ``section.name``."""
    return [
        f"{section.name}.{field.name}"
        for section in msgspec.structs.fields(ControllerSettings)
        for field in msgspec.structs.fields(section.type)
    ]


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
