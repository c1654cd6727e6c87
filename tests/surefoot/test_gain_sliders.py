"""The sliders of the live page follow the stabilizer's own values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from surefoot.robot_io.errors import RequestRefusedError, RobotUnreachableError
from surefoot.schemas.messages import SCHEMA_VERSION, StabilizerReply
from surefoot.schemas.reasons import RequestRefusal
from surefoot.view.controls import GAINS, Asker, GainSliders
from tests.support import wait_until

NAME = "tsid.com_kp"
VALUE = 30.0
UNANSWERED = 3


@dataclass
class Slider:
    value: float
    disabled: bool

    def on_update(self, react: Callable[[Any], None]) -> None:
        self._react = react

    def move(self, value: float) -> None:
        self.value = value
        self._react(None)


@dataclass
class Panel:
    """The parts of viser's panel that the sliders use."""

    sliders: dict[str, Slider] = field(default_factory=dict)

    @contextmanager
    def add_folder(self, title: str, *, expand_by_default: bool) -> Iterator[None]:
        yield

    def add_slider(
        self, label: str, *, initial_value: float, disabled: bool, hint: str, **_: float
    ) -> Slider:
        self.sliders[hint] = Slider(initial_value, disabled)
        return self.sliders[hint]


class Stabilizer:
    """Calls a function at each request, then answers with its values."""

    def __init__(self, *first: Exception) -> None:
        self.asked = 0
        self._first = list(first)

    def change_settings(self, changes: dict[str, list[float]]) -> StabilizerReply:
        if changes:
            raise RequestRefusedError(
                "refused", refusal=RequestRefusal.LEASE, detail="not now"
            )
        self.asked += 1
        if self._first:
            raise self._first.pop(0)
        return StabilizerReply(
            schema=SCHEMA_VERSION,
            accepted=True,
            refusal=RequestRefusal.NONE,
            detail="",
            tick=0,
            settings={NAME: [VALUE] * 3},
        )


def shown(stabilizer: Any) -> tuple[Panel, Asker, GainSliders]:
    panel, asker = Panel(), Asker()
    asker.through(stabilizer)
    return panel, asker, GainSliders(panel, asker)


def test_a_stabilizer_that_does_not_answer_in_time_is_asked_again() -> None:
    late = [RobotUnreachableError("no answer")] * UNANSWERED
    stabilizer = Stabilizer(*late)
    panel, asker, sliders = shown(stabilizer)
    slider = panel.sliders[NAME]

    def is_known() -> bool:
        sliders.watch(has_stabilizer=True)
        return not slider.disabled

    wait_until(is_known, what="the stabilizer's values")
    assert slider.value == VALUE
    assert stabilizer.asked == UNANSWERED + 1
    assert asker.notes == ["present gains: no answer"]
    sliders.watch(has_stabilizer=False)
    assert all(panel.sliders[gain.name].disabled for gain in GAINS)


def test_a_stabilizer_that_refuses_is_asked_once() -> None:
    why = RequestRefusedError(
        "refused", refusal=RequestRefusal.NOT_SUPPORTED, detail="takes no settings"
    )
    stabilizer = Stabilizer(why)
    panel, asker, sliders = shown(stabilizer)
    sliders.watch(has_stabilizer=True)
    wait_until(lambda: asker.notes, what="the refusal")
    sliders.watch(has_stabilizer=True)
    asker.ask("later", lambda requests: None)
    wait_until(lambda: len(asker.notes) == 2, what="what was asked later")
    assert stabilizer.asked == 1
    assert panel.sliders[NAME].disabled


def test_a_slider_goes_back_when_its_value_is_refused() -> None:
    panel, asker, sliders = shown(Stabilizer())
    slider = panel.sliders[NAME]

    def has(value: float) -> bool:
        sliders.watch(has_stabilizer=True)
        sliders.send()
        return not slider.disabled and slider.value == value

    wait_until(lambda: has(VALUE), what="the stabilizer's values")
    slider.move(VALUE + 10.0)
    wait_until(lambda: has(VALUE), what="the stabilizer's value again")
    assert asker.notes == [f"{NAME} = {VALUE + 10.0:g}: refused, not now"]
