"""Leads a controller from one set of gains to another, a little at every tick."""

from __future__ import annotations

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.live_settings import Values, between, live_values, with_values
from surefoot.schemas.messages import SCHEMA_VERSION, SettingsChange
from surefoot.schemas.settings import ControllerSettings

RAMP_S = 0.5
"""Length of a ramp [s]: a jump of a gain would make the acceleration jump."""
EVERY_TICKS = 10
"""Ticks between two steps of a ramp: each step costs some hundred microseconds."""


class SettingsRamp:
    """Settings of a running controller. Pure: counts ticks, knows no clock.

    Attributes:
        settings: in use at this tick.
        changes: all there were, in order.
    """

    def __init__(self, settings: ControllerSettings, *, period_s: float) -> None:
        """Begin with the settings the controller was made with.

        Args:
            settings: resolved.
            period_s: control period [s].
        """
        self.settings = settings
        self.changes: list[SettingsChange] = []
        self._ticks = max(1, round(RAMP_S / period_s))
        self._since = 0
        self._before: Values = {}
        self._after: Values = {}

    @property
    def is_moving(self) -> bool:
        """Whether a ramp is under way."""
        return bool(self._after)

    @property
    def targets(self) -> Values:
        """Values of all settings that may change, at the end of the ramp."""
        return {**live_values(self.settings), **self._after}

    def begin(
        self, values: Values, *, source: str, tick: int, stamp_ns: int
    ) -> SettingsChange:
        """Start towards new values, from wherever the settings are now.

        Args:
            values: as in :func:`surefoot.schemas.live_settings.with_values`.
            source: who asked.
            tick: the first tick with a changed setting.
            stamp_ns: monotonic clock [ns].

        Returns:
            What to tell and to record.

        Raises:
            FileFormatError: the values cannot be used; nothing has changed then.
        """
        if not values:
            raise FileFormatError("settings: got no change", field="changes")
        wanted = live_values(with_values(self.settings, {**self._after, **values}))
        concerned = {**self._after, **values}
        present = live_values(self.settings)
        self._before = {name: present[name] for name in concerned}
        self._after = {name: wanted[name] for name in concerned}
        self._since = 0
        change = SettingsChange(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            source=source,
            before=self._before,
            after=self._after,
            ramp_s=RAMP_S,
        )
        self.changes.append(change)
        return change

    def advance(self) -> ControllerSettings | None:
        """Go on by one tick.

        Returns:
            New settings for this tick; None when they stay as they are.
        """
        if not self._after:
            return None
        self._since += 1
        if self._since < self._ticks and self._since % EVERY_TICKS != 0:
            return None
        share = min(1.0, self._since / self._ticks)
        values = between(self._before, self._after, share=share)
        if share == 1.0:
            values, self._after = self._after, {}
        self.settings = with_values(self.settings, values)
        return self.settings
