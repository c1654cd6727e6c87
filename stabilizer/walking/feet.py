"""What each foot is doing, by plan and by what it feels.

A planted foot is the contact monitor's own. From when it is to leave until it has
landed, the walk owns it: the monitor would take a foot that is meant to be in the air
for one that lost its ground, and one that just touches for one that stands.

    planted -> leaving -> swing -> landing -> planted
                                   |     ^
                                   v     |
                                  relanding
"""

from __future__ import annotations

from enum import StrEnum

from surefoot.schemas.zmp_settings import WalkSettings
from surefoot.stabilizer.estimation.contact import Anchors, ContactMonitor

TOUCH_TICKS_S = 0.003
"""A force must last so long to be a touchdown, at least [s]."""


class FootState(StrEnum):
    """What a foot is doing."""

    PLANTED = "planted"
    LEAVING = "leaving"
    """Still carries, less and less."""
    SWING = "swing"
    LANDING = "landing"
    """On the ground, for so short a time that its forces are an impact's."""
    RELANDING = "relanding"
    """Bounced, or its ground went away: straight down again."""


class Feet:
    """The states of both feet, written into contact monitor and anchors.

    Attributes:
        states: of left and right foot.
        since_s: time since the last change of state of each.
        touched: whether each foot touched down in this tick, for the first time in
            its step.
    """

    def __init__(
        self,
        settings: WalkSettings,
        contacts: ContactMonitor,
        anchors: Anchors,
        *,
        largest_force: float,
        period_s: float,
    ) -> None:
        """Begin with both feet planted.

        Args:
            settings: thresholds and times.
            contacts: told which feet it does not own, and whether these stand.
            anchors: told which feet are where they were set down.
            largest_force: to be asked of a foot that stands [N].
            period_s: time between two updates [s].
        """
        self._settings = settings
        self._contacts, self._anchors = contacts, anchors
        self._largest, self._dt = largest_force, period_s
        self.states = [FootState.PLANTED, FootState.PLANTED]
        self.since_s = [0.0, 0.0]
        self.touched = [False, False]
        self._timer = [0.0, 0.0]
        self._landed_s = [0.0, 0.0]

    @property
    def airborne(self) -> int | None:
        """The foot that is in the air, if any."""
        return next((side for side in range(2) if self.is_airborne(side)), None)

    @property
    def arriving(self) -> int | None:
        """The foot in the air, or else one that lands, if any."""
        if self.airborne is not None or FootState.LANDING not in self.states:
            return self.airborne
        return self.states.index(FootState.LANDING)

    @property
    def landing(self) -> list[bool]:
        """Which feet feel the impact of a touchdown."""
        return [state is FootState.LANDING for state in self.states]

    def is_airborne(self, side: int) -> bool:
        """Whether a foot is in the air, by plan or since it bounced."""
        return self.states[side] in (FootState.SWING, FootState.RELANDING)

    def leave(self, side: int) -> None:
        """Have a foot unload, to be lifted."""
        self._contacts.owned[side] = True
        self._enter(side, FootState.LEAVING)

    def lift(self, side: int) -> None:
        """Have a foot leave the ground."""
        self._contacts.owned[side] = True
        self._contacts.in_contact[side] = False
        self._anchors.planted[side] = False
        self._enter(side, FootState.SWING)

    def give_back(self, side: int) -> None:
        """Leave a foot to the contact monitor again."""
        self._contacts.take_back(side)
        self._anchors.planted[side] = True
        self._enter(side, FootState.PLANTED)

    def update(self, normals: tuple[float, float], *, may_touch: bool) -> None:
        """Advance by one tick.

        Args:
            normals: measured normal forces, left and right [N].
            may_touch: whether the swing foot is far enough on its way for a force to
                be a touchdown.
        """
        for side in range(2):
            self.since_s[side] += self._dt
            self._landed_s[side] += self._dt
            self.touched[side] = False
            state = self.states[side]
            if state is FootState.SWING or state is FootState.RELANDING:
                if may_touch or state is FootState.RELANDING:
                    self._feel_for_ground(side, normals[side])
            elif state is FootState.LANDING:
                self._land(side, normals)

    def set_down(self, side: int) -> None:
        """Take a foot that is in the air to have touched down: it cannot feel it."""
        if self.is_airborne(side):
            self._touch(side)

    def settle(self, side: int) -> None:
        """Let a foot that has landed for long enough be planted, if it has."""
        if (
            self.states[side] is FootState.LANDING
            and self.since_s[side] >= self._settings.landing_s
        ):
            self.give_back(side)

    def _feel_for_ground(self, side: int, normal: float) -> None:
        pressed = normal > self._settings.touchdown_n
        self._timer[side] = self._timer[side] + self._dt if pressed else 0.0
        if self._timer[side] < max(TOUCH_TICKS_S, self._dt) - 0.5 * self._dt:
            return
        self._touch(side)

    def _touch(self, side: int) -> None:
        if self.states[side] is FootState.SWING:
            self._landed_s[side] = 0.0
            self.touched[side] = True
        self._contacts.in_contact[side] = True
        self._enter(side, FootState.LANDING)

    def _land(self, side: int, normals: tuple[float, float]) -> None:
        settings = self._settings
        if self._landed_s[side] >= settings.anchor_s:
            self._anchors.planted[side] = True
        grown = self.since_s[side] / self._contacts.reload_s * self._largest
        self._contacts.allowed[side] = min(max(grown, normals[side]), self._largest)
        off = normals[side] < settings.bounce_n
        self._timer[side] = self._timer[side] + self._dt if off else 0.0
        if (
            self._timer[side] > settings.bounce_s
            and self._contacts.in_contact[1 - side]
        ):
            self._contacts.in_contact[side] = False
            self._anchors.planted[side] = False
            self._enter(side, FootState.RELANDING)

    def _enter(self, side: int, state: FootState) -> None:
        self.states[side] = state
        self.since_s[side] = 0.0
        self._timer[side] = 0.0
