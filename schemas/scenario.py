"""Scenario file: what the world does to the robot.

Angles are written in degrees and turned into radians here, at the border.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec.structs import replace

from surefoot.schemas.arrays import Floats3, Pair
from surefoot.schemas.motions import Motion, RecordedMotion
from surefoot.schemas.robot_file import NonNegative, Positive
from surefoot.schemas.scenario_robot import (
    Delay,
    ModelError,
    Payload,
    Rod,
    Sensors,
    Start,
)
from surefoot.schemas.sensors import sensor
from surefoot.schemas.toml_file import FileStruct, convert, read_toml
from surefoot.schemas.topics import TICK_SENSORS
from surefoot.schemas.walk_plan import LONGEST_WALK_S, Walk

PositiveNumber = Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]
AXES = ("x", "y", "z")
FaultKind = Literal["drop", "freeze", "nan", "jump", "range"]
if TYPE_CHECKING:
    SensorName = str
else:  # what a file may name are the sensors there are
    SensorName = Literal[TICK_SENSORS]


class SensorFault(FileStruct, frozen=True, kw_only=True):
    """Failure of one sensor for a while, or of a part of it.

    ``drop``: its messages are not sent. ``freeze``: it repeats its last reading.
    ``nan``: it reports no numbers. ``jump``: an offset appears at once. ``range``: it
    reports a value that it cannot have measured.
    """

    sensor: SensorName
    """Sensor that fails."""
    kind: FaultKind
    """Kind of failure, see above."""
    start_s: NonNegative
    """When it begins."""
    duration_s: Annotated[float, msgspec.Meta(gt=0.0, le=3600.0)]
    """How long it lasts."""
    size: Positive | None = None
    """Size of a jump, in the unit of what jumps. Absent: 0.3 rad of the positions, 5
    rad/s of the gyroscope or 2500 N of the vertical force."""
    part: str | None = None
    """Only these of its readings fail, such as ``angular_velocity``: a name of the
    sensor's message. Absent: all; for a jump positions, gyroscope or force."""
    axis: str | None = None
    """Only this number of ``part`` fails: ``x``, ``y`` or ``z``, or a joint's name.
    Absent: all; for a jump without ``part`` the first of the gyroscope, the last of the
    force."""

    def __post_init__(self) -> None:
        """Check that only a jump has a size, and that the sensor has such a part."""
        if self.size is not None and self.kind != "jump":
            raise ValueError(f"kind {self.kind!r} takes no `size`; only `jump` does")
        if self.part is None:
            if self.axis is not None:
                raise ValueError("`axis` needs the `part` whose axis it is")
            return
        failing = sensor(self.sensor)
        if self.kind == "drop":
            raise ValueError(
                "kind 'drop' takes no `part`: a message is sent or not; `freeze` it"
            )
        if self.part not in failing.attributes:
            raise ValueError(
                f"{self.sensor} has no `part` {self.part!r}; expected one of "
                f"{', '.join(failing.attributes)}"
            )
        if self.kind == "jump" and self.size is None:
            raise ValueError("a jump of a `part` needs its `size`")
        is_axis = self.axis in (None, *AXES) or self.sensor == "joints"
        if not is_axis:
            raise ValueError(f"got `axis` {self.axis!r}, expected x, y or z")

    @property
    def offset(self) -> float:
        """Offset of a jump."""
        return sensor(self.sensor).offset.size if self.size is None else self.size


class Platform(FileStruct, frozen=True, kw_only=True):
    """Ground under one foot or both; without motion it stands still."""

    foot: Literal["left", "right", "both"]
    """Foot that stands on the platform."""
    motion: list[Motion] = []
    """Motions of the platform; they add up."""
    size_m: (
        Annotated[list[PositiveNumber], msgspec.Meta(min_length=2, max_length=2)] | None
    ) = None
    """Size along x and y. Absent: 0.8 by 0.9 under both feet, about 0.6 by 0.4 under
    one. A platform under one foot ends at the middle between the feet."""


class Tile(FileStruct, frozen=True, kw_only=True):
    """A fixed block of ground in place of the flat floor.

    Tiles may overlap. The floor goes on around tiles for as far as a walk needs, unless
    there are platforms.
    """

    center_m: Pair
    """Middle of the tile's top, x and y in the world. Unless ``start`` says otherwise,
    the robot's base is over 0, 0 and looks along x."""
    size_m: Annotated[list[PositiveNumber], msgspec.Meta(min_length=2, max_length=2)]
    """Size along x and y."""
    height_m: Annotated[float, msgspec.Meta(ge=-0.3, le=1.0)] = 0.0
    """Height of the middle of its top over the floor."""
    roll_deg: Annotated[float, msgspec.Meta(ge=-45.0, le=45.0)] = 0.0
    """Tilt about x."""
    pitch_deg: Annotated[float, msgspec.Meta(ge=-45.0, le=45.0)] = 0.0
    """Tilt about y; a positive one slopes down ahead."""
    friction: Positive | None = None
    """Friction coefficient; the scenario's when absent [1]."""
    stiffness_n_m: Annotated[float, msgspec.Meta(ge=5e3, le=1e6)] | None = None
    """Stiffness of soft ground under a whole sole; firm when absent."""
    damping_n_s_m: NonNegative | None = None
    """Damping of soft ground under a whole sole. Absent: half of critical for half the
    robot's mass."""
    tip_deg: Annotated[float, msgspec.Meta(ge=0.0, le=20.0)] = 0.0
    """Angle of a seesaw's stop, either way: it turns under the foot about the middle of
    its top. 0 for a fixed block."""
    tip_axis: Literal["roll", "pitch"] = "pitch"
    """Axis of a seesaw: its own x (roll) or y (pitch)."""

    def __post_init__(self) -> None:
        """Check that only soft ground has damping."""
        if self.damping_n_s_m is not None and self.stiffness_n_m is None:
            raise ValueError(
                "`damping_n_s_m` needs `stiffness_n_m`: firm ground takes neither"
            )


class Push(FileStruct, frozen=True, kw_only=True):
    """Force on a body, at its centre of mass.

    Its size is a force in world axes, or a share of the impulse that the soles can
    catch, which fits any robot.
    """

    body: str | None = None
    """Link of the URDF; the base link when absent."""
    force_n: Floats3 | None = None
    """Force in world axes."""
    impulse_share: Positive | None = None
    """Impulse, relative to the one whose capture point reaches the edge of the soles
    [1]. At 1.0 even a foot pressed at its edge only just catches it."""
    direction_deg: float | None = None
    """Direction of an ``impulse_share``, from where the robot looks at the start: 0
    ahead, 90 to the left; ahead when absent."""
    start_s: NonNegative
    """When it begins."""
    duration_s: Positive = 0.1
    """Time for which it acts."""

    def __post_init__(self) -> None:
        """Check that the size is given in one way only."""
        if (self.force_n is None) == (self.impulse_share is None):
            raise ValueError("expected either `force_n` or `impulse_share`")
        if self.direction_deg is not None and self.force_n is not None:
            raise ValueError("`direction_deg` goes with `impulse_share`, not `force_n`")


class Scenario(FileStruct, frozen=True, kw_only=True):
    """A run: ground, pushes, sensors and their faults, delays, model errors."""

    name: str
    """Shown in tables and kept in results."""
    duration_s: Annotated[float, msgspec.Meta(gt=0.0, le=LONGEST_WALK_S)]
    """Simulated time."""
    description: str = ""
    """One sentence for the list of scenarios."""
    friction: Positive = 0.7
    """Friction coefficient of all ground [1]."""
    platform: list[Platform] = []
    """Moving ground; without platforms the ground is firm and level."""
    tile: list[Tile] = []
    """Blocks of uneven, soft, slippery or tipping ground."""
    push: list[Push] = []
    """Forces on links."""
    rod: list[Rod] = []
    """Rods that push, pull or strike links."""
    payload: list[Payload] = []
    """Masses that the robot carries."""
    start: Start = Start()
    """How the robot stands at the start."""
    sensors: Sensors = Sensors()
    """Errors and rates of the sensors."""
    delay: Delay = Delay()
    """Transport delays."""
    model_error: ModelError = ModelError()
    """What the controller does not know."""
    fault: list[SensorFault] = []
    """Sensors that fail."""
    walk: Walk | None = None
    """Walk instead of stand."""

    def __post_init__(self) -> None:
        """Check that a foot has at most one platform, and a walk begins in time."""
        if self.walk is not None and self.walk.start_s >= self.duration_s:
            raise ValueError(
                f"at `walk.start_s`: got {self.walk.start_s:g}, expected earlier than "
                f"the scenario ends, `duration_s`, {self.duration_s:g}"
            )
        feet: list[str] = []
        for platform in self.platform:
            feet += ["left", "right"] if platform.foot == "both" else [platform.foot]
        for foot in ("left", "right"):
            if feet.count(foot) > 1:
                raise ValueError(
                    f"{foot} foot has {feet.count(foot)} platforms, at most one "
                    "allowed; motions of one platform add up"
                )


def scenario_from_table(raw: dict[str, Any], *, source: str) -> Scenario:
    """Build a scenario from a TOML table.

    Raises:
        FileFormatError: with the path of the offending key.
    """
    return convert(raw, Scenario, source=source)


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file; see :func:`scenario_from_table`.

    Paths in it are relative to the scenario file. They are resolved here.
    """
    scenario = scenario_from_table(read_toml(path), source=str(path))
    folder = path.resolve().parent
    return with_recordings(scenario, lambda motion: str(folder / motion.file))


def recordings(scenario: Scenario) -> list[RecordedMotion]:
    """Return the recorded motions of a scenario, in the order of the file."""
    return [
        motion
        for platform in scenario.platform
        for motion in platform.motion
        if isinstance(motion, RecordedMotion)
    ]


def with_recordings(
    scenario: Scenario, name_of: Callable[[RecordedMotion], str]
) -> Scenario:
    """Return a scenario whose recordings are read from elsewhere."""
    if not recordings(scenario):
        return scenario
    return replace(
        scenario,
        platform=[
            replace(
                platform,
                motion=[
                    replace(motion, file=name_of(motion))
                    if isinstance(motion, RecordedMotion)
                    else motion
                    for motion in platform.motion
                ],
            )
            for platform in scenario.platform
        ],
    )
