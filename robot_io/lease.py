"""Who commands the robot: one at a time."""

from __future__ import annotations


class Lease:
    """Command of the robot, held by one commander, lost by silence.

    Attributes:
        holder: identity of the commander; empty when nobody holds it.
    """

    def __init__(self, *, duration_s: float) -> None:
        """Starts free.

        Args:
            duration_s: a holder silent for longer loses it [s].
        """
        self.holder = ""
        self._duration_s = duration_s
        self._renewed_s = 0.0

    def take(self, who: str, *, now_s: float) -> bool:
        """Takes or renews it; False when someone else holds it."""
        if self.holder not in ("", who):
            return False
        self.holder = who
        self._renewed_s = now_s
        return True

    def renew(self, *, now_s: float) -> None:
        """The holder has been heard of."""
        self._renewed_s = now_s

    def release(self) -> None:
        """Frees it."""
        self.holder = ""

    def has_expired(self, *, now_s: float) -> bool:
        """Whether the holder has been silent for too long."""
        return bool(self.holder) and now_s - self._renewed_s > self._duration_s
