"""Checks a robot file: figures, a verdict on each, and which scenarios fit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import msgspec
import numpy as np

from surefoot.robot_files.draft import listed
from surefoot.robot_files.scenario_fit import ScenarioFit, fit
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.catalogue import list_scenarios, load_scenario
from surefoot.sim_robot.conventions import SIM_STEP_S
from surefoot.stabilizer.factory import check_settings
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.legs import ONE_FOOT_SHARE, one_foot_share
from surefoot.stabilizer.stance.nominal import (
    Standing,
    capture_limits,
    reach_search,
    stand,
)
from surefoot.stabilizer.stance.solver import Reach

if TYPE_CHECKING:
    from surefoot.stabilizer.margins.margins import LoopMargins

Verdict = Literal["ok", "warning"]

TILT_DEG, YAW_DEG = 2.0, 10.0
HEIGHT_DIFFERENCE_MM = 2.0
OFF_CENTRE_SHARE = 0.5
"""Share of a sole's half length; a CoM farther from the middle is a warning."""
SAG_DEG, SAG_MM = 2.0, 20.0
TORQUE_SHARE = 0.8
SMALLEST_SOLE, LARGEST_SOLE = 0.06, 0.4
"""Half length of the sole over height of the CoM [1]."""
ROTOR_SHARE = 3e-4
"""Rotor inertia of a leg joint over mass times height squared [1]; Walker: 4e-3."""
HEAVY_PLATE_SHARE = 0.1
KNEE_RISE_SHARE = 0.025
ANKLE_DEG = 5.0
_MM = 1e3


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the report.

    Attributes:
        name: what was checked.
        verdict: ``ok`` or ``warning``.
        got: the result in words, with units.
        advice: what to do about a warning; empty otherwise.
        values: the figures; their names have the units.
    """

    name: str
    verdict: Verdict
    got: str
    advice: str = ""
    values: dict[str, float] = {}


def quick_findings(robot: Robot) -> list[Finding]:
    """Check all that standing still needs; takes some milliseconds."""
    model = RobotModel(robot)
    standing = stand(model)
    return [
        _mass(standing, robot),
        _plates(standing, robot),
        _sensors(standing),
        _soles(standing),
        _com(standing, robot),
        _servos(standing, robot),
        _rotors(standing, model),
        _sole_size(standing, robot),
        _trunk(model),
        default_settings(robot),
    ]


def _trunk(model: RobotModel) -> Finding:
    """Check that the legs hang on the base itself."""
    pin_model = model.pin_model
    chains = []
    for frame in model.sole_ids:
        chains.append(set[int]())
        joint = int(pin_model.frames[frame].parentJoint)
        while joint > 1:
            chains[-1].add(joint)
            joint = int(pin_model.parents[joint])
    shared = listed([pin_model.names[i] for i in sorted(chains[0] & chains[1])])
    return _finding(
        "trunk",
        f"both legs hang on {shared}" if shared else "each leg hangs on the base",
        advice="links above them would lean: only the base is held upright; fix "
        f"{shared}, as new-robot does"
        if shared
        else "",
    )


def default_settings(robot: Robot) -> Finding:
    """Check that the default settings and the simulator's time step fit the robot."""
    ticks = robot.period_s / SIM_STEP_S
    advice = ""
    try:
        check_settings(ControllerSettings(), robot)
    except FileFormatError as error:
        advice = f"{error}; put what fits into a file for --settings"
    if abs(ticks - round(ticks)) > 1e-6 * ticks:
        advice = (
            f"rate_hz: it can be driven, but not simulated, where a period is a whole "
            f"multiple of {1e3 * SIM_STEP_S:g} ms"
        )
    return _finding(
        "default settings",
        f"{'do not ' if advice else ''}fit {1e3 * robot.period_s:.4g} ms from tick to "
        "tick and the robot's weight",
        advice=advice,
    )


def warnings_of(robot: Robot) -> list[str]:
    """Return a line for each warning of :func:`quick_findings`."""
    return [
        f"{robot.path}: {f.name}: {f.got}; {f.advice}"
        for f in quick_findings(robot)
        if f.verdict == "warning"
    ]


def reach_findings(robot: Robot, reach: Reach, com_height_m: float) -> list[Finding]:
    """Check how far the legs reach; ``com_height_m`` is above the soles."""
    sink, rise = robot.file.com_travel_m
    found_rise, found_sink = _MM * reach.rise_m, _MM * reach.sink_m
    is_short = found_rise < _MM * rise - 5.0 or found_sink < -_MM * sink - 5.0
    is_straight = found_rise < KNEE_RISE_SHARE * _MM * com_height_m
    advice = ""
    if is_straight:
        advice = "bend the knees more: straight legs cannot follow ground that sinks"
    elif is_short:
        advice = "com_travel_m promises more than the joints reach; make it less"
    up, down = (math.degrees(angle) for angle in reach.pitch_rad)
    roll = math.degrees(reach.roll_rad)
    least = min(up, down, roll)
    return [
        _finding(
            "reach",
            f"the CoM can rise by {found_rise:.0f} and sink by {found_sink:.0f} mm "
            f"over the feet; com_travel_m says {_MM * rise:.0f} and {-_MM * sink:.0f}",
            advice=advice,
            values={"rise_mm": found_rise, "sink_mm": found_sink},
        ),
        _finding(
            "ankle ranges",
            f"ground may tilt by {up:.0f} deg toes up, {down:.0f} deg toes down, "
            f"{roll:.0f} deg to either side",
            advice="joint ranges end near the nominal posture; bend the knees less, or "
            "keep to gentle ground"
            if least < ANKLE_DEG
            else "",
            values={"toes_up_deg": up, "toes_down_deg": down, "roll_deg": roll},
        ),
    ]


def _finding(
    name: str, got: str, *, advice: str = "", values: dict[str, float] | None = None
) -> Finding:
    """Return a finding; it is a warning if it has advice."""
    return Finding(
        name=name,
        verdict="warning" if advice else "ok",
        got=got,
        advice=advice,
        values=values or {},
    )


def _mass(standing: Standing, robot: Robot) -> Finding:
    return _finding(
        "mass",
        f"{standing.mass:.1f} kg, {robot.n_a} joints, CoM {standing.com[2]:.3f} m "
        "above the soles; all inertias are possible",
        values={"mass_kg": standing.mass, "com_height_m": float(standing.com[2])},
    )


def _plates(standing: Standing, robot: Robot) -> Finding:
    left, right = standing.plates.tolist()
    advice = ""
    if min(left, right) <= 0.0:
        advice = (
            "what is below a force-torque sensor weighs something; put its mass into "
            "the URDF, below ft_link"
        )
    elif max(left, right) > HEAVY_PLATE_SHARE * standing.mass:
        advice = "too heavy for a foot; is ft_link the link below the sensor?"
    elif abs(left - right) > 0.1 * max(left, right):
        advice = "left and right differ; do both ft_link name the same place?"
    return _finding(
        "mass below the force-torque sensors",
        f"{left:.3f} and {right:.3f} kg, with {robot.left.ft_link} and "
        f"{robot.right.ft_link}",
        advice=advice,
        values={"left_kg": left, "right_kg": right},
    )


def _sensors(standing: Standing) -> Finding:
    def direction(cosine: float) -> str:
        if abs(cosine) < math.cos(math.radians(10.0)):
            return f"{math.degrees(math.acos(cosine)):.0f} deg from up"
        return "up" if cosine > 0.0 else "down"

    left, right = standing.sensor_up.tolist()
    return _finding(
        "force-torque axes",
        f"z of the sensors points {direction(left)} and {direction(right)}; the "
        "inertial unit is fixed to the base",
        values={"left_up": left, "right_up": right},
    )


def _soles(standing: Standing) -> Finding:
    tilt = math.degrees(float(standing.sole_tilt.max()))
    yaw = math.degrees(float(np.abs(standing.sole_yaw).max()))
    step = _MM * abs(float(standing.soles[0, 2] - standing.soles[1, 2]))
    off = _MM * abs(float(standing.soles[0, 0] - standing.soles[1, 0]))
    advice = ""
    if tilt > TILT_DEG or step > HEIGHT_DIFFERENCE_MM:
        advice = "in the nominal posture both soles must lie flat on one floor"
    elif yaw > YAW_DEG:
        advice = "soles point ahead in the nominal posture; turn sole_frame or the hips"
    elif standing.soles[0, 1] < standing.soles[1, 1]:
        advice = "the left sole is on the right; are sides exchanged, or is x backward?"
    return _finding(
        "soles in the nominal posture",
        f"tilted by up to {tilt:.2f} deg, turned by {yaw:.2f} deg, {step:.1f} mm apart "
        f"in height, {off:.1f} mm ahead of each other",
        advice=advice,
        values={"tilt_deg": tilt, "yaw_deg": yaw, "step_mm": step},
    )


def _com(standing: Standing, robot: Robot) -> Finding:
    x, y = (_MM * standing.com[:2]).tolist()
    half_mm = _MM * min(robot.left.half_length_m, robot.right.half_length_m)
    between_mm = _MM * 0.5 * abs(float(standing.soles[0, 1] - standing.soles[1, 1]))
    is_off = abs(x) > OFF_CENTRE_SHARE * half_mm or abs(y) > 0.25 * between_mm
    return _finding(
        "centre of mass",
        f"{x:+.1f} mm ahead of and {y:+.1f} mm left of the middle of the soles, which "
        f"are {2.0 * half_mm:.0f} mm long",
        advice="move it over the middle: lean hips and ankles of the nominal posture"
        if is_off
        else "",
        values={"ahead_mm": x, "left_mm": y},
    )


def _servos(standing: Standing, robot: Robot) -> Finding:
    shares = np.abs(standing.torques) / robot.torque_limit
    sags = np.degrees(np.abs(standing.sag))
    weak, soft = int(np.argmax(shares)), int(np.argmax(sags))
    sag_mm = _MM * float(np.linalg.norm(standing.com_sag))
    names = robot.joint_names
    advice = ""
    if shares[weak] > TORQUE_SHARE:
        short = [names[i] for i in np.flatnonzero(shares > TORQUE_SHARE)]
        advice = (
            f"{listed(short)} can hardly hold it; bend the knees less, or check "
            "torque_limit_nm"
        )
    elif sags[soft] > SAG_DEG or sag_mm > SAG_MM:
        advice = "the servos are soft for this posture; check kp_nm_rad"
    return _finding(
        "servos under gravity",
        f"the CoM sags by {sag_mm:.1f} mm, {names[soft]} by {sags[soft]:.2f} deg; "
        f"{names[weak]} needs {100.0 * shares[weak]:.0f} % of its torque",
        advice=advice,
        values={
            "com_sag_mm": sag_mm,
            "largest_sag_deg": float(sags[soft]),
            "largest_torque_share": float(shares[weak]),
        },
    )


def _rotors(standing: Standing, model: RobotModel) -> Finding:
    robot = model.robot
    shares = robot.armature / (standing.mass * standing.com[2] ** 2)
    legs = model.is_leg[model.to_bus]
    small = [
        robot.joint_names[i] for i in np.flatnonzero(legs & (shares < ROTOR_SHARE))
    ]
    least = float(robot.armature[legs].min())
    return _finding(
        "rotor inertia of the legs",
        f"{least:.3g} kg m^2 and more",
        advice=f"{listed(small)}: hardly any; force feedback shakes such joints: enter "
        "the rotor's inertia times the gear ratio squared as armature_kg_m2"
        if small
        else "",
        values={"least_kg_m2": least},
    )


def _sole_size(standing: Standing, robot: Robot) -> Finding:
    length = min(robot.left.half_length_m, robot.right.half_length_m)
    width = min(robot.left.half_width_m, robot.right.half_width_m)
    share = length / float(standing.com[2])
    is_odd = not SMALLEST_SOLE <= share <= LARGEST_SOLE
    return _finding(
        "soles against height",
        f"{2e3 * length:.0f} x {2e3 * width:.0f} mm; half its length is "
        f"{100.0 * share:.0f} % of the height of the CoM",
        advice="expected 6 to 40 %; are half_length_m and half_width_m half sizes in m?"
        if is_odd
        else "",
        values={"half_length_m": length, "half_width_m": width},
    )


def capture_finding(capture: Array) -> Finding:
    """Tell the hardest pushes that can be caught without a step.

    Args:
        capture: (8,) limits by direction, every 45 deg from ahead to the left [N s].
    """
    ahead, left, back, right = capture[[0, 2, 4, 6]].tolist()
    return _finding(
        "capture limit of a push",
        f"{ahead:.1f} N s ahead, {back:.1f} back, {left:.1f} left, {right:.1f} right; "
        "impulse_share = 1 in a scenario",
        values={"ahead_ns": ahead, "left_ns": left, "back_ns": back, "right_ns": right},
    )


def one_foot_finding(share: float) -> Finding:
    """Check that a knee can carry the robot on one foot, as walking needs."""
    return _finding(
        "one foot",
        f"to carry the robot alone a knee needs {100.0 * share:.0f} % of its torque",
        advice="it can neither walk nor stand on one foot; bend the knees less "
        "(surefoot new-robot --rise), or check torque_limit_nm"
        if share > ONE_FOOT_SHARE
        else "",
        values={"knee_torque_share": share},
    )


class RobotFileReport(msgspec.Struct, frozen=True, kw_only=True):
    """The findings on a robot file."""

    robot: str
    path: str
    findings: list[Finding]
    scenarios: list[ScenarioFit]


def judge(robot: Robot, margins: LoopMargins) -> RobotFileReport:
    """Check a robot whose files have been loaded, and thus do not contradict."""
    model = RobotModel(robot)
    search, capture = reach_search(model), capture_limits(model)
    fits = []
    for name in list_scenarios():
        found = fit(load_scenario(name), robot, search=search, capture=capture)
        fits.append(msgspec.structs.replace(found, name=name))
    return RobotFileReport(
        robot=robot.file.name,
        path=str(robot.path),
        findings=[
            *quick_findings(robot),
            one_foot_finding(one_foot_share(model)),
            capture_finding(capture),
            *reach_findings(robot, search.reach(), float(stand(model).com[2])),
            _margins(margins),
        ],
        scenarios=fits,
    )


def _margins(found: LoopMargins) -> Finding:
    return _finding(
        f"margins, {found.servo_profile} servos",
        "; ".join(found.in_words()),
        advice=""
        if found.is_enough
        else "see surefoot margins; softer servos or a quicker loop have more",
    )
