"""Requests to a running stabilizer: hold and resume, and settings that ramp over.

Gains may change while the controller runs; limits may not.
"""

from __future__ import annotations

import logging
import time
from typing import Any

import msgspec

from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.client_side.requests import Asked
from surefoot.robot_io.errors import RequestRefusedError
from surefoot.schemas.arrays import Array
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    ControlRequest,
    SettingsChange,
    SettingsRequest,
)
from surefoot.schemas.reasons import RequestRefusal
from surefoot.schemas.settings import ControllerSettings, setting_of
from surefoot.schemas.toml_file import convert
from surefoot.schemas.validation import nearest
from surefoot.stabilizer.safety.safety import Safety

RAMP_S = 0.5
"""Length of a ramp: a jump of a gain would make the acceleration jump [s]."""
EVERY_TICKS = 10
"""Ticks between two steps of a ramp; each step costs some hundred microseconds."""
RENEW_EVERY_S = 0.25
"""Period of renewing the lease while holding [s]."""
CONTROL_ACTIONS = ("hold", "resume")
LIVE_SETTINGS = (
    "tsid.com_kp",
    "tsid.com_kd",
    "tsid.base_kp",
    "tsid.base_kd",
    "tsid.posture_kp",
    "tsid.posture_kd",
    "dik.k_force",
    "dik.com_gain",
    "dik.base_gain",
    "dik.posture_gain",
    "dik.stance_leak",
    "ground.gain",
)
"""Settings that may change during a run. Others are read once, at the controller's
start."""
Values = dict[str, list[float]]
"""Setting to its value, one number per axis."""


def live_values(settings: ControllerSettings) -> Values:
    """Return the present values of the settings that may change."""
    return {name: _numbers(setting_of(settings, name)) for name in LIVE_SETTINGS}


def with_values(settings: ControllerSettings, values: Values) -> ControllerSettings:
    """Return settings with some values replaced.

    Args:
        settings: settings to start from.
        values: new values of some of LIVE_SETTINGS: one number for all axes, or one per
            axis.

    Raises:
        FileFormatError: a setting is unknown, cannot change during a run, or its value
            is out of range.
    """
    tables: dict[str, dict[str, Any]] = msgspec.to_builtins(settings)
    for name, numbers in values.items():
        if name not in LIVE_SETTINGS:
            raise FileFormatError(
                f"{name}: cannot be changed during a run"
                f"{nearest(name, LIVE_SETTINGS)}; these can: "
                f"{', '.join(LIVE_SETTINGS)}",
                field=name,
            )
        section, key = name.split(".")
        axes = len(_numbers(setting_of(settings, name)))
        if len(numbers) not in (1, axes):
            raise FileFormatError(
                f"{name}: got {len(numbers)} numbers, expected 1 or {axes}", field=name
            )
        if isinstance(setting_of(settings, name), tuple):
            tables[section][key] = numbers * axes if len(numbers) == 1 else numbers
        else:
            tables[section][key] = numbers[0]
    return convert(tables, ControllerSettings, source="settings")


def between(before: Values, after: Values, *, share: float) -> Values:
    """Interpolate between two sets of values.

    Args:
        before: values at share 0.
        after: values of the same settings at share 1.
        share: from 0 to 1.
    """
    return {
        name: [
            old + share * (new - old)
            for old, new in zip(before[name], after[name], strict=True)
        ]
        for name in after
    }


def _numbers(value: Any) -> list[float]:
    return [float(x) for x in value] if isinstance(value, tuple) else [float(value)]


class SettingsRamp:
    """Settings of a running controller. Pure: it counts ticks and has no clock."""

    def __init__(self, settings: ControllerSettings, *, period_s: float) -> None:
        """Begin with the settings the controller was made with."""
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
        """Values at the end of the ramp, of all settings that may change."""
        return {**live_values(self.settings), **self._after}

    def begin(
        self, values: Values, *, source: str, tick: int, stamp_ns: int
    ) -> SettingsChange:
        """Start a ramp to new values from wherever the settings are now.

        Args:
            values: as in :func:`with_values`.
            source: who asked for the change.
            tick: the first tick with a changed setting.
            stamp_ns: monotonic clock [ns].

        Returns:
            The change, to be published and recorded.

        Raises:
            FileFormatError: the values cannot be used; then nothing has changed.
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


_LOG = logging.getLogger(__name__)


class RequestHandler:
    """Serves the requests to a running stabilizer: settings, hold and resume.

    Attributes:
        holding: why the robot is held; empty while the controller balances.
        q_held: posture to start again from, given once after a hold; None otherwise.
    """

    def __init__(
        self,
        client: RobotClient,
        settings: ControllerSettings,
        *,
        period_s: float,
    ) -> None:
        """Answer the requests of a connection."""
        self.holding = ""
        self.q_held: Array | None = None
        self._client = client
        self._safety: Safety | None = None
        self._ramp = SettingsRamp(settings, period_s=period_s)
        self._renew_at_s = 0.0

    @property
    def settings(self) -> ControllerSettings:
        """Settings at this tick, with all requested changes so far."""
        return self._ramp.settings

    def serve_controller(self, safety: Safety) -> None:
        """Give new gains to this watched controller from now on, if it takes any."""
        self._safety = safety

    def move_to(self, client: RobotClient) -> None:
        """Keep the present settings, and serve another connection."""
        self._client = client
        self.holding, self.q_held = "", None
        self._renew_at_s = 0.0

    @property
    def changes(self) -> list[SettingsChange]:
        """All changes of settings so far."""
        return self._ramp.changes

    def serve(self, tick: int) -> None:
        """Answer all waiting requests, then advance the settings by a tick."""
        while (asked := self._client.next_request()) is not None:
            if isinstance(asked.request, SettingsRequest):
                self._change(asked, asked.request, tick)
            else:
                self._control(asked, asked.request, tick)
        if self._ramp.is_moving and not self.holding:
            settings = self._ramp.advance()
            if settings is not None and self._safety is not None:
                self._safety.retune(settings)

    def keep_lease(self) -> None:
        """Renew the lease while holding.

        Raises:
            RequestRefusedError: somebody else has the lease, or the robot is in FAULT.
            RobotUnreachableError: the robot does not answer.
        """
        now_s = time.monotonic()
        if now_s >= self._renew_at_s:
            self._renew_at_s = now_s + RENEW_EVERY_S
            self._client.request_mode("hold")

    def _change(self, asked: Asked, request: SettingsRequest, tick: int) -> None:
        ramp = self._ramp
        safety = self._safety
        if safety is None or not safety.is_tunable:
            if request.changes:
                name = safety.controller.name if safety is not None else ""
                why = f"the controller {name} takes no settings while it runs"
                asked.reply(
                    tick=tick,
                    settings={},
                    refusal=RequestRefusal.NOT_SUPPORTED,
                    detail=why,
                )
            else:
                asked.reply(tick=tick, settings={})
            return
        if request.changes:
            try:
                change = ramp.begin(
                    request.changes,
                    source=request.source,
                    tick=tick,
                    stamp_ns=time.monotonic_ns(),
                )
            except FileFormatError as error:
                now = live_values(ramp.settings)
                asked.reply(
                    tick=tick,
                    settings=now,
                    refusal=RequestRefusal.BAD_VALUE,
                    detail=str(error),
                )
                _LOG.warning("settings refused, from %s: %s", request.source, error)
                return
            self._client.publish_change(change)
            _LOG.info("tick %d: %s", tick, in_words(change))
        asked.reply(tick=tick, settings=ramp.targets)

    def _control(self, asked: Asked, request: ControlRequest, tick: int) -> None:
        refusal, detail = self._hold_or_resume(request)
        asked.reply(tick=tick, settings={}, refusal=refusal, detail=detail)
        said = "done" if refusal is RequestRefusal.NONE else f"refused, {detail}"
        _LOG.info("tick %d: %s from %s: %s", tick, request.action, request.source, said)

    def _hold_or_resume(self, request: ControlRequest) -> tuple[RequestRefusal, str]:
        """Hold or resume; return the refusal (``none`` when done) and a text."""
        if request.action not in CONTROL_ACTIONS:
            got = f"got action {request.action!r}, expected hold or resume"
            return RequestRefusal.UNKNOWN_ACTION, got
        try:
            if request.action == "hold":
                self._client.request_mode("hold")
                self.holding = f"hold asked for by {request.source}"
            elif self.holding:
                self.q_held = self._client.enable()
                self.holding = ""
        except RequestRefusedError as error:
            return error.refusal, error.detail
        return RequestRefusal.NONE, ""


def in_words(change: SettingsChange) -> str:
    """Return a change of settings on one line, for the log."""
    parts = [
        f"{name} {_text(change.before, name)} -> {_text(change.after, name)}"
        for name in change.after
    ]
    return f"{', '.join(parts)}, over {change.ramp_s:g} s, from {change.source}"


def _text(values: Values, name: str) -> str:
    numbers = values[name]
    if len(set(numbers)) == 1:
        numbers = numbers[:1]
    return " ".join(f"{number:g}" for number in numbers)
