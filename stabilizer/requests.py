"""Answers what the stabilizer is asked, between two ticks and never inside one."""

from __future__ import annotations

import logging
import time

from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.client_side.requests import Asked
from surefoot.robot_io.errors import RequestRefusedError
from surefoot.schemas.arrays import Array
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.live_settings import Values, live_values
from surefoot.schemas.messages import ControlRequest, SettingsChange, SettingsRequest
from surefoot.schemas.reasons import RequestRefusal
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.controller import Controller, Tunable
from surefoot.stabilizer.settings_ramp import SettingsRamp

_LOG = logging.getLogger(__name__)

RENEW_EVERY_S = 0.25
"""While holding, the lease is renewed so often."""
CONTROL_ACTIONS = ("hold", "resume")


class RequestHandler:
    """Settings, hold and resume of a running stabilizer.

    Attributes:
        holding: why the robot is held; empty while the controller balances.
        q_held: posture to start again from, once after a hold; None otherwise.
    """

    def __init__(
        self,
        client: RobotClient,
        settings: ControllerSettings,
        *,
        period_s: float,
    ) -> None:
        """Answer what comes in on a connection.

        Args:
            client: where requests come from.
            settings: controllers are made with, until others are asked for.
            period_s: control period [s].
        """
        self.holding = ""
        self.q_held: Array | None = None
        self._client, self._name = client, ""
        self._tunable: Tunable | None = None
        self._ramp = SettingsRamp(settings, period_s=period_s)
        self._renew_at_s = 0.0

    @property
    def settings(self) -> ControllerSettings:
        """As they are at this tick, with all changes asked for so far."""
        return self._ramp.settings

    def serve_controller(self, controller: Controller) -> None:
        """Give new gains to this controller from now on, if it can take any."""
        self._name = controller.name
        self._tunable = controller if isinstance(controller, Tunable) else None

    def move_to(self, client: RobotClient) -> None:
        """Go on with the settings as they are, on another connection."""
        self._client = client
        self.holding, self.q_held = "", None
        self._renew_at_s = 0.0

    @property
    def changes(self) -> list[SettingsChange]:
        """All changes of settings so far."""
        return self._ramp.changes

    def serve(self, tick: int) -> None:
        """Answer all that has come in, then move the settings on by a tick.

        Args:
            tick: the one about to be answered.
        """
        while (asked := self._client.next_request()) is not None:
            if isinstance(asked.request, SettingsRequest):
                self._change(asked, asked.request, tick)
            else:
                self._control(asked, asked.request, tick)
        if self._ramp.is_moving and not self.holding:
            settings = self._ramp.advance()
            if settings is not None and self._tunable is not None:
                self._tunable.retune(settings)

    def keep_lease(self) -> None:
        """While holding: stays the robot's commander.

        Raises:
            RequestRefusedError: somebody else is, or the robot is in fault.
            RobotUnreachableError: no answer.
        """
        now_s = time.monotonic()
        if now_s >= self._renew_at_s:
            self._renew_at_s = now_s + RENEW_EVERY_S
            self._client.request_mode("hold")

    def _change(self, asked: Asked, request: SettingsRequest, tick: int) -> None:
        ramp = self._ramp
        if self._tunable is None:
            if request.changes:
                why = f"the controller {self._name} takes no settings while it runs"
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
        """Why not, and the same in words; ``none`` when done."""
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
    """A change of settings on one line, for the log."""
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
