"""How far a robot's loops are from swaying: what ``surefoot margins`` tells."""

from __future__ import annotations

import msgspec

ENOUGH_DB = 6.0
"""Gain margin to have: a robot that yields twice as much as was thought [dB]."""


class AxisMargin(msgspec.Struct, frozen=True, kw_only=True):
    """Margins of one axis of one foot, the others closed; None: there is no limit."""

    foot: str
    """Left or right."""
    axis: str
    """Of the sole frame: x y z roll pitch yaw."""
    gain_db: float | None = None
    """How much more this axis may yield to a wrench error [dB]."""
    phase_deg: float | None = None
    """How much its phase may change [deg]."""
    delay_ms: float | None = None
    """How much later its readings may be [ms]."""


class LoopMargins(msgspec.Struct, frozen=True, kw_only=True):
    """Margins of all axes of a robot that stands on still ground."""

    robot: str
    """Its name."""
    servo_profile: str
    """How its servos follow."""
    rate_hz: float
    """Control ticks in a second."""
    delay_ms: float
    """Delay of the loop that the margins are at: from a reading to the step its
    answer acts in [ms]."""
    stable: bool
    """Whether it stands without swaying at all; if not, the axes have no margins."""
    gain_db: float | None
    """By how much all axes together may yield more; negative: have to yield less, not
    to sway; None: without limit [dB]."""
    disk: float
    """Disk margin of all axes together, 0 to 2 [1]."""
    disk_gain_db: float | None
    """Any factor so large or small, another on every axis, is borne; None: any [dB]."""
    disk_phase_deg: float
    """Any phase so large, another on every axis, is borne [deg]."""
    loop_delay_ms: float
    """Largest delay of the loop that is borne, a whole number of ticks; negative:
    none [ms]."""
    missed_ticks: int
    """Longest train of missed ticks that is borne however often it comes, with one
    answered tick in between."""
    axes: list[AxisMargin]
    """Left foot, then right."""

    @property
    def worst_db(self) -> float | None:
        """Smallest gain margin, of one axis or of all together; None: no limit."""
        found = [axis.gain_db for axis in self.axes if axis.gain_db is not None]
        if self.gain_db is not None:
            found.append(self.gain_db)
        return min(found, default=None)

    @property
    def is_enough(self) -> bool:
        """Whether it stands, and every gain margin is large enough."""
        worst = self.worst_db
        return self.stable and (worst is None or worst >= ENOUGH_DB)

    def in_words(self) -> list[str]:
        """Say what is borne, one sentence per line."""
        if not self.stable:
            return [
                f"sways at a loop delay of {self.delay_ms:g} ms: "
                + (
                    "whatever the gains"
                    if self.gain_db is None
                    else f"|K| has to grow by more than {-self.gain_db:.1f} dB"
                )
            ]
        worst = self.worst_db
        least = "no limit" if worst is None else f"{worst:.1f} dB"
        disk = "any" if self.disk_gain_db is None else f"{self.disk_gain_db:.1f} dB"
        return [
            f"least gain margin {least}"
            + ("" if self.is_enough else f", less than the {ENOUGH_DB:g} dB to have"),
            f"all axes at once, each another: {disk} or {self.disk_phase_deg:.0f} deg "
            f"(disk margin {self.disk:.2f})",
            f"bears a loop delay of {self.loop_delay_ms:g} ms, and trains of "
            f"{self.missed_ticks} missed ticks",
        ]
