"""Controller settings: every gain, weight and limit, with its unit and effect.

Every published figure was made with the defaults. A TOML file may give any subset;
``--set tsid.com_kp=40`` overrides one. A single number stands for all axes of a setting
that has several.
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
    """Time at rest after the start: mean tilt and gyroscope bias are measured while the
    posture is held [s]."""
    still_rate_rad_s: Positive = 0.03
    """Rate of turn confirmed by gravity's direction, plus its change, above which the
    ground turns while calibrating. Gravity's direction alone then tells the gyroscope
    bias."""
    tilt_bandwidth: Positive = 0.5
    """Bandwidth of the roll and pitch correction by accelerometer and legs [rad/s]."""
    gyro_bias_gain: NonNegative = 0.02
    """Gain with which the gyroscope bias is learnt [1/s^2]."""
    yaw_gain: NonNegative = 1.0
    """Gain that pulls the yaw to the stance [1/s]."""
    accel_bias_memory_s: Positive = 60.0
    """Memory of the comparison of accelerometer and feet, which tells the
    accelerometer's horizontal bias from a lean [s]."""
    height_bandwidth: Positive = 0.5
    """Bandwidth of the height's pull to the legs' kinematics while the ground moves
    [rad/s]. Below it the ground is assumed level on average; above it the accelerometer
    decides."""
    height_damping: Positive = 0.15
    """Damping ratio of that pull; less damping lets less ground motion through [1]."""
    height_bias_pull: NonNegative = 0.07
    """Rate at which the bias of the vertical acceleration follows while the ground
    moves; on still ground it takes two seconds [rad/s]."""
    still_height_bandwidth: Positive = 2.5
    """Bandwidth of the same pull on still ground; its damping ratio is 0.7 [rad/s]."""
    still_speed_m_s: Positive = 0.01
    """Vertical ground speed that separates still from moving ground."""
    anchor_cutoff_hz: Positive = 5.0
    """Low-pass of the load share, which places the anchor between the feet."""


class ContactSettings(FileStruct, frozen=True, kw_only=True):
    """When a foot counts as standing, and how a lifted foot searches for the ground."""

    lost_below_n: NonNegative = 15.0
    """Normal force below which contact is lost [N]."""
    regained_above_n: Positive = 40.0
    """Normal force above which contact is regained [N]."""
    lost_after_s: NonNegative = 0.005
    """Time below the threshold until contact is lost."""
    regained_after_s: NonNegative = 0.003
    """Time above the threshold until contact is regained."""
    search_force_n: Positive = 80.0
    """Normal force that a lifted foot seeks, or 0.115 of the robot's weight if that is
    more [N]."""
    descent_limit_m_s: Positive = 0.4
    """Largest speed of a lifted foot that searches for the ground."""
    reload_s: Positive = 0.15
    """Time after which a foot that regained contact takes its full share."""
    stiffness_n_m: Positive = 1e7
    """Stiffness of one sole and its ground along the normal, for the margins: hard
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
    """One lost ankle sensor: go on without its force terms, or hold the posture."""
    both_ft_lost: Literal["degrade", "hold"] = "hold"
    """Both ankle sensors lost: the same choice."""
    bridge_s: Positive = 0.01
    """Time for which the last good reading replaces missing or impossible ones; then
    the sensor is lost [s]."""
    frozen_after_s: Positive = 0.02
    """Time of identical readings, while others change, until a sensor is lost [s]."""
    recover_s: Positive = 0.1
    """Time of good readings until a lost ankle sensor is used again [s]."""
    force_range_n: Positive = 12000.0
    """Largest force an ankle sensor can report, each axis [N]. A foot hit by rising
    ground feels 5000 for some ms."""
    moment_range_nm: Positive = 1500.0
    """Largest moment an ankle sensor can report, each axis [N m]."""
    force_jump_n: Positive = 7000.0
    """Largest change of an ankle force in one tick, each axis [N]."""
    moment_jump_nm: Positive = 1000.0
    """Largest change of an ankle moment in one tick, each axis [N m]."""
    overload_n: Positive = 1500.0
    """Force above which a foot is overloaded: only an impact reaches it. At least twice
    the robot's weight, which a foot may be asked to carry [N]."""
    overload_after_s: Positive = 0.03
    """Time of overload after which the sensor is lost; impacts are shorter [s]."""
    sole_margin_m: Positive = 0.02
    """Distance outside of a sole at which its pressure, moments by normal force, is
    impossible; for less than half of the weight as for half of it [m]."""
    gyro_range_rad_s: Positive = 35.0
    """Largest rate of turn the IMU can report, each axis [rad/s]."""
    accel_range_m_s2: Positive = 300.0
    """Largest specific force the IMU can report, each axis [m/s^2]."""
    gyro_jump_rad_s: Positive = 4.0
    """Largest change of the rate of turn in one tick, each axis [rad/s]."""
    accel_jump_m_s2: Positive = 200.0
    """Largest change of the specific force in one tick, each axis [m/s^2]."""
    attitude_gap_rad: Positive = 0.025
    """Angle by which the gyroscope and the IMU's own attitude may differ in half a
    second [rad]. More for a unit whose filter follows the accelerometer quickly."""
    joint_margin_rad: Positive = 0.2
    """Distance outside its range beyond which a joint reading is impossible [rad]."""
    joint_jump_rad: Positive = 0.1
    """Largest change of any joint in one tick [rad]."""
    tilt_limit_rad: Positive = 0.8
    """Tilt from the start beyond which the robot has fallen [rad]."""
    unloaded_n: Positive = 30.0
    """Total load of both feet below which they count as unloaded [N]."""
    unloaded_after_s: Positive = 1.0
    """Time without load on the feet after which the robot has fallen [s]."""
    ramp_out_s: Positive = 0.05
    """Time in which the last motion fades out, after a lost sensor or a fall, before
    the posture is held [s]."""
    leave_s: Annotated[float, msgspec.Meta(ge=0.0, le=5.0)] = 0.05
    """Time for which the controller, asked to stop, balances on with less and less
    motion before the posture is held; 0 holds at once [s]."""

    def __post_init__(self) -> None:
        """Refuse forces in the wrong order."""
        if not self.unloaded_n < self.overload_n < self.force_range_n:
            raise ValueError(
                f"`unloaded_n`, `overload_n` and `force_range_n` are "
                f"{self.unloaded_n:g}, {self.overload_n:g} and "
                f"{self.force_range_n:g}, expected them to rise in this order"
            )


class WalkSettings(FileStruct, frozen=True, kw_only=True):
    """How the steps of a plan are taken; for every controller that walks."""

    shift_s: Positive = 0.8
    """Duration of the first weight shift, from standing onto one foot."""
    settle_s: Positive = 0.6
    """Duration of the last weight shift, back between the feet."""
    preview_steps: Annotated[int, msgspec.Meta(ge=1, le=10)] = 3
    """Number of steps that the DCM reference looks ahead [1]."""
    horizontal_part: Share = 0.85
    """Part of single support in which the swing foot travels [1]."""
    apex_part: Share = 0.45
    """Part of single support after which the swing foot is highest [1]."""
    touchdown_m_s: Positive = 0.05
    """Speed towards the expected ground at the planned touchdown."""
    late_m_s: Positive = 0.3
    """Downward speed when the ground was expected and is not met."""
    late_depth_m: Positive = 0.12
    """Largest depth to which a foot searches below the expected ground [m]."""
    unloaded_share: Fraction = 0.13
    """Part of the weight below which a foot may leave the ground [1]."""
    unload_wait_s: NonNegative = 0.1
    """Longest wait for a foot to unload; then it leaves all the same."""
    touchdown_n: Positive = 40.0
    """Normal force at which a foot in the air has touched down [N]."""
    caught_share: Positive = 0.1
    """A foot in the air is caught at an edge if the force against its way is more than
    this part of the weight, and more than the force from below [1]."""
    step_over_m: NonNegative = 0.03
    """Additional height with which a caught foot goes on; 0 makes it push on [m]."""
    landing_s: Positive = 0.12
    """Time after touchdown for which a foot counts as landing."""
    landing_force_n: Positive = 250.0
    """Largest normal force error that a landing foot yields to [N]."""
    bounce_n: NonNegative = 15.0
    """Normal force below which a landing foot has bounced [N]."""
    bounce_s: NonNegative = 0.012
    """Time below that force until it counts as a bounce."""
    anchor_s: NonNegative = 0.05
    """Time after touchdown until which the odometry follows the foot."""
    early_share: Fraction = 0.08
    """Part of the weight asked of a foot that touched down early [1]."""
    leaving_margin: Fraction = 0.15
    """Part of the weight that a leaving foot may carry beyond its planned part [1]."""
    lead_s: NonNegative = 0.005
    """Lead of the swing foot's velocity in addition to the servos' own lag [s]."""
    swing_gain: Positive = 12.0
    """Second QP: position and orientation gain of the swing foot [1/s]."""
    swing_kp: Positive = 100.0
    """First QP: position gain of the swing foot [1/s^2]."""
    swing_kd: Positive = 20.0
    """First QP: velocity gain of the swing foot [1/s]."""
    swing_weight: Positive = 0.3
    """First QP: weight of the swing foot; the CoM has 1 [1]."""
    height_s: Positive = 1.5
    """Time constant with which the height reference follows the feet [s]."""
    climb_s: Positive = 0.15
    """Time constant of each of three low-passes to planned heights [s]."""
    normal_filter_s: Positive = 0.03
    """Low-pass of the expected ground's normal [s]."""
    normal_agreement: Positive = 0.06
    """Disagreement of the soles' normals, or of the line between the soles, above which
    they show no common ground [rad]."""
    adjust: Literal["off", "place", "both"] = "both"
    """Whether a step changes its place, or place and time, when the DCM leaves its
    reference."""
    adjust_dead_m: tuple[NonNegative, NonNegative] = (0.02, 0.015)
    """DCM error, ahead and sideways, up to which no step is changed [m]."""
    adjust_filter_s: Positive = 0.03
    """Low-pass of the DCM error, which impacts shake [s]."""
    adjust_growth_m: Positive = 0.13
    """Shift of a step that costs as much as a longer step in which the DCM gets twice
    as far [m]."""
    adjust_offset_weight: Positive = 5.0
    """Weight of the DCM's offset at the end of the step, relative to the step's shift
    [1]."""
    adjust_zmp_share: Fraction = 0.5
    """Part of the sole in which the ZMP is assumed to answer a DCM error. Over the
    outer edge of the standing foot it is the whole sole [1]."""
    adjust_wait_s: NonNegative = 0.3
    """Longest extension of single support [s]."""
    adjust_pause_m: Positive = 0.05
    """DCM error above which no foot leaves the ground [m]."""
    adjust_pause_s: NonNegative = 0.8
    """Longest time for which a foot is kept down by that [s]."""
    adjust_rate_m_s: Positive = 2.0
    """Largest speed at which a step is shifted [m/s]."""
    adjust_limit_m: tuple[Positive, Positive] = (0.25, 0.20)
    """Largest shift of a step, ahead and sideways [m]."""
    adjust_until_s: NonNegative = 0.05
    """Time before the planned touchdown within which the step stays [s]."""
    cross_ahead_m: NonNegative = 0.42
    """Distance ahead of the standing foot, or behind it, at which the other foot passes
    on a crossing step, so that the legs do not meet. 0, or more than `longest_m`: feet
    do not cross [m]."""
    between_soles_m: NonNegative = 0.015
    """Least sideways gap between the soles [m]."""
    farthest_m: Positive = 0.45
    """Largest sideways distance between the middles of the feet [m]."""
    longest_m: Positive = 0.5
    """Largest distance of a foothold ahead of the other foot, or behind it [m]."""
    turn_limit_rad: Positive = 0.6
    """Largest turn of one foot against the other [rad]."""
    rise_limit_m: Positive = 0.2
    """Largest height difference between two footholds [m]."""


class ControllerSettings(FileStruct, frozen=True, kw_only=True):
    """All settings of all controllers."""

    whole_body: WholeBodySettings = WholeBodySettings()
    """Variant of the whole-body stabilizer's law."""
    tsid: TsidSettings = TsidSettings()
    """First QP (TSID)."""
    dik: DikSettings = DikSettings()
    """Second QP (DIK)."""
    ground: GroundSettings = GroundSettings()
    """Feed-forward of the ground's motion."""
    sway: SwaySettings = SwaySettings()
    """Swaying with ground that tilts."""
    estimator: EstimatorSettings = EstimatorSettings()
    """State estimator."""
    contact: ContactSettings = ContactSettings()
    """Contact of the feet."""
    safety: SafetySettings = SafetySettings()
    """Plausibility of sensors, stopping and falling."""
    zmp: ZmpSettings = ZmpSettings()
    """The ZMP baseline."""
    walk: WalkSettings = WalkSettings()
    """Steps of a walk."""


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
"""Values set by each preset, unless the settings file or the command line gives
them."""


def build_settings(
    table: dict[str, Any], *, overrides: list[str], source: str = "settings"
) -> ControllerSettings:
    """Merge defaults, a settings table and command-line overrides.

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
    """Merge the table over the values of the preset that it names."""
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
    """Return the nearest setting, else the section's settings, else all sections."""
    near = difflib.get_close_matches(key, known, n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    section = key.split(".")[0]
    inside = [name for name in known if name.startswith(f"{section}.")]
    if inside:
        return f"{section} has {', '.join(inside)}"
    sections = dict.fromkeys(name.split(".")[0] for name in known)
    return f"settings are SECTION.NAME, with sections {', '.join(sections)}"
