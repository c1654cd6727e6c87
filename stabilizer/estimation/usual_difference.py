"""By how much feet and accelerometer differ as a rule, and when they suddenly do."""

from __future__ import annotations

MEMORY_S = 60.0
"""How long a difference takes to be the new usual one."""
LAG_S = 0.1
"""Low-pass by which a sudden one is noticed [s]."""
SUDDEN_M_S2 = 0.05
"""No sensor's drift: the robot carries something, is held or hit [m/s^2]."""
ODD_FOR_S = 1.0
"""After so long what came suddenly is the new usual."""
NOISE_M_S2 = 0.008
"""By so much noise may be off in the first readings; more is feet that settle."""
CALM_FOR_S = 0.3
"""So long after a sudden difference, and after feet in the air, the next one counts."""


class UsualDifference:
    """Tells a difference of the vertical accelerations from what is usual.

    In what remains, feet and accelerometer may be averaged. Of a bounce all counts or
    nothing: blows and rests have no effect together, but parts of them would drive the
    height away. So nothing is told until it has been over for a while.

    Attributes:
        usual: what the accelerometer feels more than the feet as a rule [m/s^2].
        change: of it in the last tick, by drift, or as far as noise of the first
            readings may have been off [m/s^2].
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin without a difference.

        Args:
            period_s: time between two updates [s].
        """
        self._dt = period_s
        self._count = 0
        self._sudden = self._odd_s = 0.0
        self._calm_s = CALM_FOR_S
        self._better = self._known = 0.0
        self.usual = self.change = 0.0

    def calibrate(self, difference: float | None) -> None:
        """Take one of a robot that keeps its posture; None: not known [m/s^2]."""
        self._count += 1
        if difference is not None:
            self.usual += (difference - self.usual) / self._count

    def unusual(self, difference: float | None) -> float:
        """Return what is not usual in a difference, and no bounce either [m/s^2].

        Args:
            difference: as for :meth:`calibrate`.
        """
        self.change = 0.0
        if difference is None:
            self._calm_s = 0.0
            return 0.0
        unusual = difference - self.usual
        self._sudden += self._dt / LAG_S * (unusual - self._sudden)
        if abs(self._sudden) > SUDDEN_M_S2:
            self._calm_s = 0.0
            self._odd_s += self._dt
            if self._odd_s > ODD_FOR_S:
                self.usual += self._sudden
                self._sudden = 0.0
                self._count = round(LAG_S / self._dt)
            return 0.0
        self._odd_s = 0.0
        self._calm_s += self._dt
        if self._calm_s < CALM_FOR_S:
            return 0.0
        self._count += 1
        least = self._dt / MEMORY_S
        gain = max(1.0 / self._count, least)
        self.usual += gain * unusual
        before = self._known
        self._better += (gain - least) * unusual
        self._known = min(max(self._better, -NOISE_M_S2), NOISE_M_S2)
        self.change = least * unusual + self._known - before
        return unusual
