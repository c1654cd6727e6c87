"""Signals of a run: everything that is recorded at every tick, by name.

This table serves memory, ticks files, exports, reports and the documentation.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from surefoot.schemas.errors import SchemaError

Dtype = Literal["float64", "int64", "int8"]


class KnownBy(StrEnum):
    """Who knows a signal."""

    CLOCK = "clock"
    ROBOT = "robot"
    CONTROLLER = "controller"
    SIMULATOR = "simulator"


JOINTS = "joints"
"""An axis with an entry per joint, in the order of the robot file."""
PLATFORMS = "platforms"
"""An axis with an entry per platform, in the order of the scenario, from 0."""
Axis = str | tuple[str, ...]

_XYZ = ("x", "y", "z")
_XY = ("x", "y")
_FOOTHOLD = ("x", "y", "z", "yaw")
_FOOTHOLD_UNITS = ("m", "m", "m", "rad")
_QUAT = ("qx", "qy", "qz", "qw")
_WRENCH = ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")
_WRENCH_UNITS = ("N",) * 3 + ("N m",) * 3
_TWIST = ("v_x", "v_y", "v_z", "w_x", "w_y", "w_z")
_TWIST_UNITS = ("m/s",) * 3 + ("rad/s",) * 3
_SIDES = ("left", "right")
_POSE_UNITS = ("m",) * 3 + ("1",) * 4
MISSING = -1
"""Value of a whole-number signal that nobody reported. Others are NaN then."""
QP_WORDS = (
    *("ok", "not tried", "sensors not finite", "not finite", "no contact"),
    *(
        "singular contact",
        "max_iter_reached",
        "primal_infeasible",
        "dual_infeasible",
        "numerics",
    ),
    *("unsolved", "invalid_settings", "other"),
)
"""Words for the status of a QP by its number; the last stands for any other word."""


def _per_side(labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{label}_{side}" for side in _SIDES for label in labels)


@dataclass(frozen=True, slots=True)
class Signal:
    """A row of the table: one signal.

    Attributes:
        name: the same everywhere.
        known_by: who knows it.
        unit: unit of all its numbers, or one per label; ``1`` for numbers without.
        frame: in which its numbers are given; empty where that means nothing.
        meaning: in a sentence.
        axes: axes of one tick's value: labels, or ``JOINTS`` or ``PLATFORMS``.
        dtype: of its numbers.
        words: what the numbers 0, 1, ... stand for; empty for plain numbers.
    """

    name: str
    known_by: KnownBy
    unit: str | tuple[str, ...]
    frame: str
    meaning: str
    axes: tuple[Axis, ...] = ()
    dtype: Dtype = "float64"
    words: tuple[str, ...] = ()


_R, _C, _S = KnownBy.ROBOT, KnownBy.CONTROLLER, KnownBy.SIMULATOR
_WRENCHES = (_per_side(_WRENCH),)
_WRENCHES_UNITS = _WRENCH_UNITS * 2
_STANCE = "stance"
SIGNALS = (
    Signal("tick", KnownBy.CLOCK, "1", "", "The robot's counter.", dtype="int64"),
    Signal("time_s", KnownBy.CLOCK, "s", "", "The robot's time: ticks times period."),
    Signal("q", _R, "rad", "joint", "Measured joint positions.", (JOINTS,)),
    Signal("dq", _R, "rad/s", "joint", "Measured joint velocities.", (JOINTS,)),
    Signal("effort", _R, "N m", "joint", "Torques of the servos.", (JOINTS,)),
    Signal(
        "q_command",
        _R,
        "rad",
        "joint",
        "Positions the servos follow during the tick: the controller's, once the gate "
        "has let them pass and their delay is over.",
        (JOINTS,),
    ),
    Signal(
        "quat_xyzw",
        _R,
        "1",
        "world from IMU",
        "Attitude that the inertial unit itself reports.",
        (_QUAT,),
    ),
    Signal("angular_velocity", _R, "rad/s", "IMU", "The gyroscope's.", (_XYZ,)),
    Signal(
        "linear_acceleration",
        _R,
        "m/s^2",
        "IMU",
        "Specific force: at rest one g, upwards.",
        (_XYZ,),
    ),
    Signal(
        "ft_left",
        _R,
        _WRENCH_UNITS,
        "left ankle sensor",
        "Force and moment from below on the left ankle, as the sensor reports them.",
        (_WRENCH,),
    ),
    Signal(
        "ft_right",
        _R,
        _WRENCH_UNITS,
        "right ankle sensor",
        "The same of the right ankle.",
        (_WRENCH,),
    ),
    Signal(
        "F_id",
        _C,
        _WRENCHES_UNITS,
        "soles",
        "Wanted wrenches of the ground on both soles.",
        _WRENCHES,
    ),
    Signal(
        "F_meas",
        _C,
        _WRENCHES_UNITS,
        "soles",
        "The same as measured: the ankle sensors', carried over to the soles.",
        _WRENCHES,
    ),
    Signal(
        "base_pose",
        _C,
        _POSE_UNITS,
        _STANCE,
        "Estimated pose of the base: position and quaternion.",
        ((*_XYZ, *_QUAT),),
    ),
    Signal(
        "base_twist",
        _C,
        _TWIST_UNITS,
        "base",
        "Estimated twist of the base.",
        (_TWIST,),
    ),
    Signal("com", _C, "m", _STANCE, "Estimated centre of mass.", (_XYZ,)),
    Signal(
        "com_reference",
        _C,
        "m",
        _STANCE,
        "Where the centre of mass should be.",
        (_XYZ,),
    ),
    Signal(
        "in_contact",
        _C,
        "1",
        "",
        "Whether the controller takes each foot to stand.",
        (_SIDES,),
        dtype="int8",
        words=("no", "yes"),
    ),
    Signal(
        "r",
        _C,
        _TWIST_UNITS * 2,
        "soles",
        "Wanted twists of both soles.",
        (_per_side(_TWIST),),
    ),
    Signal(
        "v_joint",
        _C,
        "rad/s",
        "joint",
        "Joint velocities that the second QP answers with.",
        (JOINTS,),
    ),
    Signal(
        "wrench_qp",
        _C,
        "1",
        "",
        "Status of the QP that gives F_id.",
        dtype="int8",
        words=QP_WORDS,
    ),
    Signal(
        "motion_qp",
        _C,
        "1",
        "",
        "Status of the QP that gives the joint velocities.",
        dtype="int8",
        words=QP_WORDS,
    ),
    Signal(
        "controller_ms",
        KnownBy.CLOCK,
        "ms",
        "",
        "Time the controller took, snapshot to command; by the wall clock.",
    ),
    Signal(
        "dcm",
        _C,
        "m",
        _STANCE,
        "Estimated divergent component of motion, of a robot that walks.",
        (_XY,),
    ),
    Signal("dcm_reference", _C, "m", _STANCE, "Where it should be.", (_XY,)),
    Signal(
        "zmp_reference",
        _C,
        "m",
        _STANCE,
        "Zero-moment point that the steps are planned with.",
        (_XY,),
    ),
    Signal(
        "footholds",
        _C,
        _FOOTHOLD_UNITS * 2,
        _STANCE,
        "Where the feet were set down, and those in the air are.",
        (_per_side(_FOOTHOLD),),
    ),
    Signal(
        "foot_goals",
        _C,
        _FOOTHOLD_UNITS * 2,
        _STANCE,
        "The same, but those in the air where they are being set.",
        (_per_side(_FOOTHOLD),),
    ),
    Signal(
        "walk_phase",
        _C,
        "1",
        "",
        "What the walk is at.",
        dtype="int8",
        words=("stand", "shift", "single", "double", "settle"),
    ),
    Signal(
        "foot_state",
        _C,
        "1",
        "",
        "What each foot is doing.",
        (_SIDES,),
        dtype="int8",
        words=("planted", "leaving", "swing", "landing", "relanding"),
    ),
    Signal("true_com", _S, "m", "world", "Centre of mass.", (_XYZ,)),
    Signal("true_com_velocity", _S, "m/s", "world", "Its velocity.", (_XYZ,)),
    Signal(
        "true_base_pose",
        _S,
        _POSE_UNITS,
        "world",
        "Pose of the base: position and quaternion.",
        ((*_XYZ, *_QUAT),),
    ),
    Signal("true_sole_left", _S, "m", "world", "Origin of the left sole.", (_XYZ,)),
    Signal("true_sole_right", _S, "m", "world", "Origin of the right sole.", (_XYZ,)),
    Signal(
        "true_F",
        _S,
        _WRENCHES_UNITS,
        "soles",
        "Wrenches of the ground on both soles, over the last step of the simulation.",
        _WRENCHES,
    ),
    Signal(
        "true_platform_pose",
        _S,
        _POSE_UNITS,
        "world",
        "Pose of each platform's top centre: position and quaternion.",
        (PLATFORMS, (*_XYZ, *_QUAT)),
    ),
)
"""All signals, in the order in which they are listed everywhere."""
WALK_SIGNALS = (
    *("dcm", "dcm_reference", "zmp_reference", "footholds", "foot_goals"),
    *("walk_phase", "foot_state"),
)
"""Signals that are kept only if the scenario has the robot walk."""
BY_NAME = {signal.name: signal for signal in SIGNALS}


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """A signal for one robot and scenario: every number has its label.

    Attributes:
        name: as in the table.
        known_by: who knows it.
        units: unit of each label.
        frame: in which its numbers are given; empty where that means nothing.
        meaning: in a sentence.
        shape: shape of one tick's value.
        labels: labels of its numbers in C order; one empty label for a single number.
        dtype: of its numbers.
        words: what the numbers 0, 1, ... stand for; empty for plain numbers.
    """

    name: str
    known_by: KnownBy
    units: tuple[str, ...]
    frame: str
    meaning: str
    shape: tuple[int, ...]
    labels: tuple[str, ...]
    dtype: Dtype
    words: tuple[str, ...] = ()

    @property
    def unit(self) -> str:
        """Its unit; several are joined, as ``N, N m``."""
        return ", ".join(dict.fromkeys(self.units))

    @property
    def columns(self) -> tuple[str, ...]:
        """Column names of its numbers in tables: ``q.left_knee``, ``F_id.f_z_left``."""
        return tuple(
            f"{self.name}.{label}" if label else self.name for label in self.labels
        )

    @property
    def missing(self) -> float | int:
        """Value that stands for a missing one."""
        return math.nan if self.dtype == "float64" else MISSING

    def metadata(self) -> dict[str, str]:
        """The layout as texts, for a file's channel metadata."""
        return {
            "known_by": self.known_by.value,
            "unit": self.unit,
            "units": json.dumps(self.units),
            "frame": self.frame,
            "meaning": self.meaning,
            "shape": json.dumps(self.shape),
            "labels": json.dumps(self.labels),
            "dtype": self.dtype,
            "words": json.dumps(self.words),
        }


def layout_from_metadata(name: str, texts: Mapping[str, str]) -> SignalLayout:
    """Build a layout from what :meth:`SignalLayout.metadata` returned.

    Raises:
        SchemaError: the texts do not describe a layout.
    """
    try:
        dtype = texts["dtype"]
        if dtype not in ("float64", "int64", "int8"):
            raise ValueError(f"dtype {dtype!r}")
        layout = SignalLayout(
            name=name,
            known_by=KnownBy(texts["known_by"]),
            units=_texts(texts["units"]),
            frame=texts["frame"],
            meaning=texts["meaning"],
            shape=tuple(int(size) for size in json.loads(texts["shape"])),
            labels=_texts(texts["labels"]),
            dtype=dtype,  # type: ignore[arg-type]
            words=_texts(texts["words"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise SchemaError(f"signal {name}: its layout is damaged ({error})") from error
    sizes = math.prod(layout.shape), len(layout.labels), len(layout.units)
    if min(layout.shape, default=1) < 1 or len(set(sizes)) != 1:
        raise SchemaError(
            f"signal {name}: its layout contradicts itself: shape {layout.shape}, "
            f"{sizes[1]} labels, {sizes[2]} units"
        )
    return layout


def _texts(data: str) -> tuple[str, ...]:
    values = json.loads(data)
    if not isinstance(values, list):
        raise ValueError(f"{data!r} is no list")
    return tuple(str(value) for value in values)


def lay_out(name: str, *, joints: Sequence[str], platforms: int = 0) -> SignalLayout:
    """Lay out a signal of the table for a robot and a scenario.

    Args:
        name: of the signal.
        joints: joint names, in the order of the robot file.
        platforms: number of platforms in the scenario, seesaws included.

    Raises:
        SchemaError: the signal has no numbers, for lack of platforms or joints.
    """
    signal = BY_NAME[name]
    axes = [_labels(axis, joints, platforms) for axis in signal.axes]
    labels = [""]
    for axis in axes:
        labels = [f"{head}.{label}".lstrip(".") for head in labels for label in axis]
    if not labels:
        raise SchemaError(f"signal {name}: got none of its {signal.axes[0]}")
    units = (signal.unit,) if isinstance(signal.unit, str) else signal.unit
    return SignalLayout(
        name=name,
        known_by=signal.known_by,
        units=units * (len(labels) // len(units)),
        frame=signal.frame,
        meaning=signal.meaning,
        shape=tuple(len(axis) for axis in axes),
        labels=tuple(labels),
        dtype=signal.dtype,
        words=signal.words,
    )


def _labels(axis: Axis, joints: Sequence[str], platforms: int) -> Sequence[str]:
    if axis == JOINTS:
        return joints
    if axis == PLATFORMS:
        return [f"platform_{index}" for index in range(platforms)]
    return axis
