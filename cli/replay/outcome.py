"""What came of computing a record's commands again."""

from __future__ import annotations

import msgspec


class Difference(msgspec.Struct, kw_only=True, frozen=True):
    """A joint whose command was another one."""

    tick: int
    time_s: float
    """Tick times the control period [s]."""
    joint: str
    recorded: float
    """[rad]"""
    computed: float
    """[rad]"""

    @property
    def error(self) -> float:
        """Computed less recorded [rad]."""
        return self.computed - self.recorded


class SessionOutcome(msgspec.Struct, kw_only=True):
    """One stabilizer of the record."""

    commander: str
    controller: str
    first_tick: int
    last_tick: int
    compared: int = 0
    """Commands compared."""
    differing: int = 0
    """Commands that are not equal bit for bit."""
    stale: int = 0
    """Ticks compared for which the record lacks the message of a sensor."""
    first: Difference | None = None
    """The first that differs; of its joints the one that differs most."""
    largest: Difference | None = None
    """The largest difference of any joint at any tick."""


class ReplayOutcome(msgspec.Struct, kw_only=True):
    """The whole record."""

    file: str
    robot: str
    is_cut_off: bool
    is_equal: bool
    """Whether all commands compared are equal bit for bit."""
    compared: int
    sessions: list[SessionOutcome]
    notes: list[str]
    """What was other than when the record was made, or could not be compared."""
