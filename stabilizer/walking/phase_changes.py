"""Decides when a phase of a walk is over, and what comes next."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.estimation.contact import ContactMonitor
from surefoot.stabilizer.walking.dcm import Point
from surefoot.stabilizer.walking.feet import Feet, FootState
from surefoot.stabilizer.walking.footsteps import Foothold
from surefoot.stabilizer.walking.gait import Gait, Phase
from surefoot.stabilizer.walking.step_queue import Move

LEAVING_FROM = 0.3
"""Planned share of the weight below which the walk owns a foot that is to leave."""


class PhaseChanges:
    """Ends the phases of a gait: by time, feet and DCM."""

    def __init__(
        self,
        settings: WalkSettings,
        *,
        gait: Gait,
        feet: Feet,
        contacts: ContactMonitor,
        weight: float,
        half_sizes: tuple[float, float],
        period_s: float,
    ) -> None:
        """Begin standing.

        Args:
            settings: of walking.
            gait: gait whose phases are ended.
            feet: is told which foot leaves, or stays after all.
            contacts: contact monitor of the observer.
            weight: of the robot [N].
            half_sizes: half length and half width of a sole [m].
            period_s: time between two updates [s].
        """
        self._settings, self._dt = settings, period_s
        self._gait, self._feet, self._contacts = gait, feet, contacts
        self._weight = weight
        self._pause = Pause(settings, half_sizes=half_sizes, period_s=period_s)
        self._waited_s = 0.0

    def begin(self) -> None:
        """Begin a walk with the shift onto the first foot."""
        self._waited_s = 0.0
        self._pause.begin()

    def pause_at(
        self, dcm: Point, footholds: Callable[[], list[Foothold]]
    ) -> Point | None:
        """Return where the ZMP waits, both feet down, until the DCM is back.

        Args:
            dcm: estimated DCM [m].
            footholds: returns the places of both feet.

        Returns:
            Place of the ZMP [m]; None to go on.
        """
        if self._gait.phase is not Phase.DOUBLE:
            return None
        return self._pause.at(dcm, self._gait, footholds())

    def update(
        self,
        normals: tuple[float, float],
        footholds: Callable[[], list[Foothold]],
        ahead: Callable[[], Sequence[Move]],
        *,
        moved: int | None,
        pauses: bool,
    ) -> int | None:
        """Change to the next phase when the present one is over.

        Args:
            normals: normal forces, left and right [N].
            footholds: returns the places of both feet.
            ahead: returns the coming steps.
            moved: foot of the last step; None before the first.
            pauses: whether both feet stay down, whatever the time.

        Returns:
            The foot to be lifted now: all else depends on that step. None for no foot.
        """
        gait, feet = self._gait, self._feet
        phase = gait.phase
        if phase is Phase.SINGLE and gait.left_s > 0.0:
            return None
        for side in range(2):
            feet.settle(side)
        if phase in (Phase.SHIFT, Phase.DOUBLE):
            leaving = 1 - gait.support
            if pauses:
                self._stay(leaving)
                return None
            return self._leave(leaving, normals[leaving], footholds, ahead())
        if phase is Phase.SINGLE:
            assert moved is not None
            if self._contacts.in_contact[moved]:
                self._waited_s = 0.0
                self._pause.begin()
                if ahead():
                    gait.begin_double()
                else:
                    gait.begin_settle()
        elif phase is Phase.SETTLE and gait.left_s == 0.0:
            is_down = all(state is FootState.PLANTED for state in feet.states)
            rests = gait.rests(footholds())
            if is_down and rests and all(self._contacts.in_contact):
                gait.stand()
        return None

    def _leave(
        self,
        leaving: int,
        normal: float,
        footholds: Callable[[], list[Foothold]],
        moves: Sequence[Move],
    ) -> int | None:
        """Make a foot leave once it is time and it is unloaded; return it then."""
        gait, feet = self._gait, self._feet
        if moves and feet.states[leaving] is FootState.PLANTED:
            left = gait.left_share(footholds())
            if (left if leaving == 0 else 1.0 - left) < LEAVING_FROM:
                feet.leave(leaving)
        loaded = normal > self._settings.unloaded_share * self._weight
        if gait.left_s > 0.0 and (loaded or not moves or not self._pause.is_lost):
            return None
        if not moves:
            self._stay(leaving)
            gait.begin_settle()
            return None
        self._waited_s += self._dt
        waits = loaded and self._waited_s <= self._settings.unload_wait_s
        support = gait.support
        stands = self._contacts.in_contact[support] and not feet.is_airborne(support)
        return None if waits or not stands else leaving

    def _stay(self, leaving: int) -> None:
        if self._feet.states[leaving] is FootState.LEAVING:
            self._feet.give_back(leaving)


class Pause:
    """Keeps both feet down while the DCM is off its reference, but over the soles.

    Attributes:
        is_lost: whether the DCM is off and beyond the soles: only a step can help.
    """

    def __init__(
        self,
        settings: WalkSettings,
        *,
        half_sizes: tuple[float, float],
        period_s: float,
    ) -> None:
        """Begin without a pause.

        Args:
            settings: has the error from which on to pause, and for how long.
            half_sizes: half length and half width of a sole [m].
            period_s: time between two updates [s].
        """
        self._settings, self._dt = settings, period_s
        self._half_sizes = half_sizes
        self._paused_s = 0.0
        self.is_lost = False

    def begin(self) -> None:
        """Begin a double support."""
        self._paused_s, self.is_lost = 0.0, False

    def at(self, dcm: Point, gait: Gait, feet: Sequence[Foothold]) -> Point | None:
        """Advance by one tick of double support.

        Args:
            dcm: estimated DCM [m].
            gait: has the reference of the DCM.
            feet: places of left and right foot.

        Returns:
            Place where the ZMP waits [m]; None to go on.
        """
        settings = self._settings
        x, y = dcm
        off = math.hypot(x - gait.dcm[0], y - gait.dcm[1])
        self.is_lost = False
        if settings.adjust != "both" or off < settings.adjust_pause_m:
            return None
        here, there = feet[gait.support], feet[1 - gait.support]
        self.is_lost = not is_over(dcm, here, there, half_sizes=self._half_sizes)
        if self.is_lost or self._paused_s >= settings.adjust_pause_s:
            return None
        self._paused_s += self._dt
        return x, y


def is_over(
    point: Point,
    here: Foothold,
    there: Foothold,
    *,
    half_sizes: tuple[float, float],
) -> bool:
    """Return whether a point is over a sole, or on the way from it to another one.

    With the DCM there a robot can wait: its ZMP can get to the DCM's other side.

    Args:
        point: [m].
        here: place of the sole.
        there: place of the other sole; ``here`` again for a foot that stands alone.
        half_sizes: half length and half width of a sole [m].
    """
    x, y, _ = there.seen_from(here)
    ahead, left, _ = Foothold(*point, 0.0, 0.0).seen_from(here)
    # A sole moved along the way is under the point from the part ``first`` of the way
    # up to the part ``last``, whichever its direction.
    first, last = 0.0, 1.0
    for off, way, half in zip((ahead, left), (x, y), half_sizes, strict=True):
        if abs(way) < 1e-6:
            if abs(off) >= half:
                return False
            continue
        ends = ((off - half) / way, (off + half) / way)
        first, last = max(first, min(ends)), min(last, max(ends))
    return first < last
