"""How robot and controller keep time with each other."""

from __future__ import annotations

from enum import StrEnum


class Pace(StrEnum):
    """Whose time counts."""

    LOCKSTEP = "lockstep"
    """The robot waits for the answer to each tick: the same run every time."""
    REALTIME = "realtime"
    """The robot goes by the clock and follows the newest command, as hardware does."""
