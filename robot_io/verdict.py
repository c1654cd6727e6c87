"""What the command gate says of a command."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class Refusal(StrEnum):
    """Why a command never reached the servos; the keys of ``refused`` on status."""

    MALFORMED = "malformed"
    """Not a joint command: bytes, fields, types."""
    SCHEMA = "schema"
    """Written for another schema version."""
    LEASE = "lease"
    """From someone who does not hold the lease."""
    MODE = "mode"
    """The robot is not ACTIVE."""
    SEQUENCE = "sequence"
    """Repeated or out of order."""
    LATE = "late"
    """Answers sensors too long ago, by ticks or by the robot's clock."""
    FUTURE = "future"
    """Answers a tick that has not been."""
    SIZE = "size"
    """Not one number per joint."""
    NOT_FINITE = "not_finite"
    """A NaN or an infinity."""
    LIMIT = "limit"
    """Beyond a limit, where the robot file says to refuse and not to clip."""
    FIRST_COMMAND = "first_command"
    """The first one after enabling is far from the held posture."""


class Limit(StrEnum):
    """What a command ran into; the keys of ``clipped`` on status."""

    POSITION = "position"
    VELOCITY = "velocity"
    STEP = "step"


class Verdict(NamedTuple):
    """Outcome of one command.

    Attributes:
        accepted: whether the servos follow it, clipped or as it is.
        refusal: why not.
        clipped: limits it ran into.
    """

    accepted: bool
    refusal: Refusal | None = None
    clipped: tuple[Limit, ...] = ()


class Answer(NamedTuple):
    """Outcome of a request.

    Attributes:
        accepted: whether it was done.
        reason: why not; empty when accepted.
    """

    accepted: bool
    reason: str = ""
