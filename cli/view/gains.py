"""Sliders for the main gains; what they are moved to goes over the bus."""

from __future__ import annotations

import threading
import time
from typing import Any, NamedTuple

from cli.view.asker import Asker
from robot_io.requests import Requests

SETTLED_S = 0.25
"""A slider at rest for so long is taken at its word."""
SAME = 1e-9


class Gain(NamedTuple):
    """A slider: the setting it moves, on all its axes.

    Attributes:
        name: the setting.
        label: what people call it, with unit.
        low: end of the slider.
        high: other end.
        step: of the slider.
        sign: -1 for a setting that is negative by convention.
    """

    name: str
    label: str
    low: float
    high: float
    step: float
    sign: float = 1.0


GAINS = (
    Gain("tsid.com_kp", "CoM stiffness [1/s²]", 5.0, 120.0, 1.0),
    Gain("tsid.com_kd", "CoM damping [1/s]", 1.0, 40.0, 0.5),
    Gain("tsid.base_kp", "Base stiffness [1/s²]", 10.0, 300.0, 5.0),
    Gain("tsid.base_kd", "Base damping [1/s]", 2.0, 60.0, 1.0),
    Gain("dik.k_force", "Foot stiffness |K|", 20.0, 200.0, 5.0, -1.0),
    Gain("dik.com_gain", "CoM position gain [1/s]", 0.5, 6.0, 0.1),
    Gain("dik.base_gain", "Base position gain [1/s]", 0.5, 6.0, 0.1),
)


class GainSliders:
    """Sliders that show the stabilizer's own values and change them."""

    def __init__(self, gui: Any, asker: Asker) -> None:
        """Adds the sliders, disabled until the stabilizer's values are known.

        Args:
            gui: ``server.gui`` of viser.
            asker: sends what is moved.
        """
        self._asker = asker
        self._lock = threading.Lock()
        self._known: dict[str, float] = {}
        self._moved: dict[str, float] = {}
        self._moved_at_s = 0.0
        self._handles: dict[str, Any] = {}
        with gui.add_folder("Gains (ramped over 0.5 s, recorded)"):
            for gain in GAINS:
                self._handles[gain.name] = handle = gui.add_slider(
                    gain.label,
                    min=gain.low,
                    max=gain.high,
                    step=gain.step,
                    initial_value=gain.low,
                    disabled=True,
                    hint=gain.name,
                )
                handle.on_update(self._note_move(gain))

    @property
    def are_known(self) -> bool:
        """Whether the stabilizer's values are shown."""
        return bool(self._known)

    def forget(self) -> None:
        """The stabilizer went away: another one may have other values."""
        with self._lock:
            self._known, self._moved = {}, {}
        for handle in self._handles.values():
            handle.disabled = True

    def learn(self, requests: Requests) -> None:
        """Asks the stabilizer for its values and shows them."""
        reply = requests.change_settings({})
        values = reply.settings
        for gain in GAINS:
            if gain.name not in values:
                continue
            numbers = values[gain.name]
            mean = gain.sign * sum(numbers) / len(numbers)
            shown = min(max(mean, gain.low), gain.high)
            with self._lock:
                self._known[gain.name] = shown
            handle = self._handles[gain.name]
            handle.value = shown
            handle.disabled = False

    def send(self) -> None:
        """Sends what was moved once the hand is off; called now and then."""
        with self._lock:
            if not self._moved or time.monotonic() - self._moved_at_s < SETTLED_S:
                return
            moved, self._moved = self._moved, {}
            self._known.update(moved)
        signs = {gain.name: gain.sign for gain in GAINS}
        changes = {name: [signs[name] * value] for name, value in moved.items()}
        text = ", ".join(f"{name} = {value[0]:g}" for name, value in changes.items())
        self._asker.ask(text, lambda requests: requests.change_settings(changes))

    def _note_move(self, gain: Gain) -> Any:
        def on_update(event: Any) -> None:
            value = float(self._handles[gain.name].value)
            with self._lock:
                known = self._known.get(gain.name)
                if known is None or abs(value - known) < SAME:
                    self._moved.pop(gain.name, None)
                    return
                self._moved[gain.name] = value
                self._moved_at_s = time.monotonic()

        return on_update
