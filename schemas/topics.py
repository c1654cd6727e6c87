"""Topic table: every channel of the robot's bus, in one place."""

from __future__ import annotations

import re
from enum import StrEnum

import msgspec

from surefoot.schemas import messages
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.sensors import SENSORS
from surefoot.schemas.walk_plan import WalkPlan, WalkStatus

_NO_KEY = re.compile(r"[*$?#\s]")


class Direction(StrEnum):
    """Who sends on a channel."""

    FROM_ROBOT = "from robot"
    TO_ROBOT = "to robot"
    SERVICE = "service of the robot"
    TO_STABILIZER = "to stabilizer"
    FROM_STABILIZER = "from stabilizer"
    STABILIZER_SERVICE = "service of the stabilizer"


class Topic(msgspec.Struct, frozen=True):
    """One channel: its key is relative to the robot's namespace."""

    name: str
    key: str
    direction: Direction
    message: type[msgspec.Struct]
    rate: str
    description: str


TOPICS: tuple[Topic, ...] = (
    *(
        Topic(entry.name, entry.key, Direction.FROM_ROBOT, entry.message, entry.rate,
              entry.description)
        for entry in SENSORS
    ),
    Topic("status", "state/status", Direction.FROM_ROBOT, messages.RobotStatus,
          "50 Hz and on change", "mode, fault, commander, refusals"),
    Topic("joint_command", "cmd/joints", Direction.TO_ROBOT, messages.JointCommand,
          "every tick", "joint positions to follow"),
    Topic("mode", "srv/mode", Direction.SERVICE, messages.ModeRequest,
          "on request", "enable, hold, disable, reset"),
    Topic("lease", "srv/lease", Direction.SERVICE, messages.LeaseRequest,
          "on request", "take or release command of the robot"),
    Topic("estop", "srv/estop", Direction.SERVICE, messages.EstopRequest,
          "on request", "stop now; open to everyone"),
    Topic("reference", "ref", Direction.TO_STABILIZER, messages.Reference,
          "as planned", "what a planner asks of the stabilizer"),
    Topic("walk", "walk", Direction.TO_STABILIZER, WalkPlan,
          "as planned", "steps to take: a plan, not a state"),
    Topic("walk_status", "stabilizer/walk", Direction.FROM_STABILIZER, WalkStatus,
          "50 Hz", "how the walk goes; once there was a plan"),
    Topic("stabilizer", "stabilizer/status", Direction.FROM_STABILIZER,
          messages.StabilizerStatus, "50 Hz", "desired and measured wrenches, timing"),
    Topic("walk_taken", "stabilizer/plan", Direction.FROM_STABILIZER, WalkPlan,
          "on change", "steps taken over, from this tick on: a planner's or its own; a "
          "long plan in parts that have tick and stamp in common"),
    Topic("settings_change", "stabilizer/settings", Direction.FROM_STABILIZER,
          messages.SettingsChange, "on change", "settings changed during a run"),
    Topic("settings", "srv/settings", Direction.STABILIZER_SERVICE,
          messages.SettingsRequest, "on request", "change gains, validated and ramped"),
    Topic("control", "srv/control", Direction.STABILIZER_SERVICE,
          messages.ControlRequest, "on request", "hold the posture, resume balancing"),
    Topic("push", "srv/push", Direction.SERVICE, messages.PushRequest,
          "on request", "simulator only: push a link"),
    Topic("truth", "truth", Direction.FROM_ROBOT, messages.Truth,
          "50 Hz", "simulator only: true state, never for control"),
)  # fmt: skip

ALIVE_ROBOT = "alive/robot"
ALIVE_STABILIZER = "alive/stabilizer"
ALIVE_OBSERVER = "alive/observer"
"""Liveliness tokens. A stabilizer or observer appends its name. The robot appends its
process's instance and its description's digest: ``alive/robot/INSTANCE/DIGEST``."""

SERVICES = (Direction.SERVICE, Direction.STABILIZER_SERVICE)
"""Directions of services, which answer requests and carry no messages."""
PUBLISHED = tuple(entry for entry in TOPICS if entry.direction not in SERVICES)
"""Channels that carry messages."""
ALL_CHANNELS = tuple(entry.name for entry in PUBLISHED)
"""Names of the channels that carry messages."""
TICK_SENSORS = tuple(entry.name for entry in SENSORS)
"""Channels that make up one snapshot, in the order in which they are sent."""
COMMAND = "joint_command"
URGENT = (*TICK_SENSORS, COMMAND)
"""Channels of the control loop, sent before everything else."""


def topic(name: str) -> Topic:
    """Find a channel by name.

    Raises:
        KeyError: no such channel; the message lists the valid names.
    """
    for entry in TOPICS:
        if entry.name == name:
            return entry
    raise KeyError(f"no channel {name!r}; there are {[t.name for t in TOPICS]}")


def is_key(text: str) -> bool:
    """Whether a text is a key, or a prefix of keys: parts separated by slashes.

    Patterns, such as those of access rules, miss parts that begin with @.
    """
    is_each_seen = all(part and part[0] != "@" for part in text.split("/"))
    return is_each_seen and not _NO_KEY.search(text)


def resolve_keys(overrides: dict[str, str]) -> dict[str, str]:
    """Return the keys of all channels, after a robot file's overrides.

    Args:
        overrides: channel name to key; a leading slash (as ROS writes it) is
            dropped, since a Zenoh key has none.

    Returns:
        Channel name to key, relative to the robot's namespace.

    Raises:
        FileFormatError: unknown channel, an empty key, or one key used twice.
    """
    keys = {entry.name: entry.key for entry in TOPICS}
    for name, key in overrides.items():
        if name not in keys:
            raise FileFormatError(
                f"keys.{name}: no such channel; valid are {sorted(keys)}",
                field=f"keys.{name}",
            )
        cleaned = key.strip("/")
        if not is_key(cleaned):
            raise FileFormatError(
                f"keys.{name}: got {key!r}, expected a key such as 'sensor/ft/left' "
                "without wildcards, blanks or @",
                field=f"keys.{name}",
            )
        keys[name] = cleaned
    seen: dict[str, str] = {}
    for name, key in keys.items():
        if key in seen:
            raise FileFormatError(
                f"keys.{name}: key {key!r} is also used by {seen[key]}; "
                "every channel needs its own",
                field=f"keys.{name}",
            )
        seen[key] = name
    return keys
