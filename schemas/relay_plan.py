"""Relay plan: faults that a relay adds to the messages between robot and stabilizer."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from surefoot.schemas.robot_file import NonNegative
from surefoot.schemas.toml_file import FileStruct, load
from surefoot.schemas.topics import TOPICS, Direction
from surefoot.schemas.validation import nearest_or_all

Probability = Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]
Milliseconds = Annotated[float, msgspec.Meta(gt=0.0, le=10000.0)]
Seconds = Annotated[float, msgspec.Meta(gt=0.0, le=3600.0)]
SPEAKERS = {
    "sensors": [Direction.FROM_ROBOT],
    "commands": [Direction.TO_ROBOT],
    "all": [Direction.FROM_ROBOT, Direction.TO_ROBOT],
}
"""Senders whose channels each direction covers."""


class _Fault(FileStruct, frozen=True, kw_only=True):
    """Fields of all faults: channels and times.

    Time counts from the first joint command that passes. Before that, no message is
    changed.
    """

    topics: list[str] = []
    """Names of channels; give either these or a direction."""
    direction: Literal["sensors", "commands", "all"] | None = None
    """All messages of the robot, the joint commands, or both. Services, the reference
    and the stabilizer's own messages are only reached by name."""
    start_s: NonNegative = 0.0
    duration_s: Seconds | None = None
    """Duration; until the end when absent."""

    def __post_init__(self) -> None:
        """Check that channels are given one way only, and exist."""
        if bool(self.topics) == (self.direction is not None):
            raise ValueError("give either `topics` or `direction`")
        known = [entry.name for entry in TOPICS]
        for name in self.topics:
            if name not in known:
                raise ValueError(
                    f"topics: no channel {name!r}{nearest_or_all(name, known)}"
                )

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels that the fault acts on."""
        if self.direction is None:
            return tuple(dict.fromkeys(self.topics))
        speakers = SPEAKERS[self.direction]
        return tuple(entry.name for entry in TOPICS if entry.direction in speakers)

    def is_on(self, at_s: float) -> bool:
        """Return whether the fault acts on messages at a time [s]."""
        end_s = math.inf if self.duration_s is None else self.start_s + self.duration_s
        return self.start_s <= at_s < end_s


class DropFault(_Fault, frozen=True, kw_only=True, tag="drop", tag_field="kind"):
    """Messages are lost, each by chance."""

    probability: Probability


class DelayFault(_Fault, frozen=True, kw_only=True, tag="delay", tag_field="kind"):
    """Messages are delayed by a fixed time, in order."""

    ms: Milliseconds


class JitterFault(_Fault, frozen=True, kw_only=True, tag="jitter", tag_field="kind"):
    """Messages are delayed by a random time, in order."""

    ms: Milliseconds
    """Longest delay; all delays up to it are equally likely."""


class DuplicateFault(
    _Fault, frozen=True, kw_only=True, tag="duplicate", tag_field="kind"
):
    """Messages come twice, each by chance."""

    probability: Probability
    ms: NonNegative = 0.0
    """Time from the first copy to the second."""


class ReorderFault(_Fault, frozen=True, kw_only=True, tag="reorder", tag_field="kind"):
    """Messages are kept back, each by chance, and others overtake them."""

    probability: Probability
    ms: Milliseconds = 2.5
    """Time for which a message is kept back."""


class CorruptFault(_Fault, frozen=True, kw_only=True, tag="corrupt", tag_field="kind"):
    """Bits of messages are flipped, by chance."""

    probability: Probability
    bits: Annotated[int, msgspec.Meta(ge=1, le=64)] = 1
    """Number of bits flipped in each message that is hit."""


class CutFault(_Fault, frozen=True, kw_only=True, tag="cut", tag_field="kind"):
    """All messages are lost for a while."""

    def __post_init__(self) -> None:
        """Check that a cut ends."""
        _Fault.__post_init__(self)
        if self.duration_s is None:
            raise ValueError("kind 'cut' needs `duration_s`; say how long it lasts")


class ClockJumpFault(
    _Fault, frozen=True, kw_only=True, tag="clock_jump", tag_field="kind"
):
    """Time stamps are shifted, as after a jump of the sender's clock."""

    seconds: float
    """Shift; positive: the clock jumped ahead. No stamp gets below zero."""

    def __post_init__(self) -> None:
        """Check that the messages have stamps."""
        _Fault.__post_init__(self)
        for entry in TOPICS:
            fields = entry.message.__struct_fields__
            if entry.name in self.channels and "stamp_ns" not in fields:
                raise ValueError(
                    f"topics: what {entry.name!r} carries has no stamp to change"
                )


RelayFault = (
    DropFault
    | DelayFault
    | JitterFault
    | DuplicateFault
    | ReorderFault
    | CorruptFault
    | CutFault
    | ClockJumpFault
)


class RelayPlan(FileStruct, frozen=True, kw_only=True):
    """Faults of the bus, in the order in which a message meets them."""

    name: str
    description: str = ""
    fault: list[RelayFault] = []

    def faults_of(self, channel: str) -> list[tuple[int, RelayFault]]:
        """Return faults that act on a channel, each with its place in the file."""
        return [
            (index, fault)
            for index, fault in enumerate(self.fault)
            if channel in fault.channels
        ]


def load_relay_plan(path: Path) -> RelayPlan:
    """Read a plan file.

    Raises:
        FileFormatError: with the path of the offending key.
    """
    return load(path, RelayPlan)
