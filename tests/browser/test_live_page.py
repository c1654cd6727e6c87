"""The live page in a real browser, with a real robot and stabilizer.

The tests share one page and one run, and come in the order of a visit: look first, stop
the robot last.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from surefoot.robot_io.bus.bus import Bus, loopback_endpoints
from surefoot.robot_io.bus.channel import Latest
from surefoot.robot_io.bus.session import Role
from surefoot.schemas.endpoints import write_endpoints
from surefoot.schemas.messages import RobotMode, RobotStatus
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.result import ControllerResult, PlantResult
from surefoot.schemas.topics import topic
from tests.browser.pictures import coloured_pixels, pixels_changed
from tests.command import command, environment
from tests.support import PATIENCE_S, free_port, wait_until

MOVED_PIXELS = 150
CURVE_PIXELS = 100
COM_STIFFNESS = 2
"""Index of the slider; force and duration of the push come first."""
SCENARIO = """
name = "heaving ground"
duration_s = 3600.0
[[platform]]
foot = "both"
  [[platform.motion]]
  axis = "z"
  kind = "sine"
  amplitude_m = 0.04
  frequency_hz = 0.2
"""
"""It only heaves, so that the robot tilts only by a push or a hold."""
NARROW = {"width": 320, "height": 240}
"""A small picture once the scene has moved: fewer pixels to draw."""


class Visit:
    """Robot, stabilizer and page, with their logs by name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.endpoints = loopback_endpoints()
        file = folder / "endpoints.toml"
        write_endpoints(file, self.endpoints)
        port = free_port()
        self.url = f"http://127.0.0.1:{port}"
        scenario = folder / "heaving.toml"
        scenario.write_text(SCENARIO)
        meet = ("--endpoints", file)
        self.view = self._start("view", "--port", port, *meet)
        # In lockstep: the browser draws on the processors of robot and stabilizer, and
        # how quick they are is not what is tested here.
        self.robot = self._start("robot", scenario, *meet, "--json")
        self.stabilizer = self._start("stabilizer", *meet, "--json")

    def log(self, name: str) -> str:
        """Return the log of a process, which must still run."""
        text = (self.folder / f"{name}.log").read_text()
        assert getattr(self, name).poll() is None, text
        return text

    def end(self) -> None:
        for process in (self.view, self.stabilizer, self.robot):
            process.kill()
            process.communicate()

    def _start(self, name: str, *words: object) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.log").open("w") as log:
            return subprocess.Popen(
                command(name, *words),
                env=environment(),
                stdout=subprocess.PIPE,
                stderr=log,
            )


@pytest.fixture(scope="module")
def visit(tmp_path_factory: pytest.TempPathFactory, chromium: Any) -> Iterator[Visit]:
    del chromium  # without a browser nothing is started
    visit = Visit(tmp_path_factory.mktemp("visit"))
    try:
        wait_until(lambda: "Ctrl-C" in visit.log("view"), what="the page")
        yield visit
    finally:
        visit.end()


@pytest.fixture(scope="module")
def open_page(page: Any, visit: Visit) -> Any:
    page.goto(visit.url)
    page.get_by_text("balancing", exact=True).wait_for()
    return page


def test_the_robot_moves(open_page: Any) -> None:
    canvas = open_page.locator("canvas[data-engine]")
    before = canvas.screenshot()
    wait_until(
        lambda: pixels_changed(open_page, before, canvas.screenshot()) > MOVED_PIXELS,
        what="the picture to change",
    )
    open_page.set_viewport_size(NARROW)


def test_the_plots_fill(open_page: Any) -> None:
    plots = open_page.locator(".uplot canvas")
    wait_until(lambda: plots.count() >= 4, what="four plots")
    for index in range(4):
        plot = plots.nth(index)
        wait_until(
            partial(_has_curves, plot),
            what=f"curves in plot {index}",
        )


def test_nothing_comes_from_elsewhere(open_page: Any) -> None:
    assert open_page.strangers == []


def test_a_slider_changes_the_gain_and_the_log_has_it(
    open_page: Any, visit: Visit
) -> None:
    open_page.get_by_text("Gains (ramped").click()
    slider = open_page.get_by_role("slider").nth(COM_STIFFNESS)
    assert slider.get_attribute("aria-valuenow") == "30"
    slider.focus()
    slider.press("ArrowRight")
    wait_until(
        lambda: (
            "tsid.com_kp 30 -> 31, over 0.5 s, from live-page"
            in visit.log("stabilizer")
        ),
        what="the change in the stabilizer's log",
    )


def test_a_push_reaches_the_simulator(open_page: Any, visit: Visit) -> None:
    open_page.get_by_text("forward", exact=True).click()
    wait_until(
        lambda: "push forward, 120 N for 0.1 s: done" in visit.log("view"),
        what="the push",
    )


def test_hold_and_resume(open_page: Any, visit: Visit) -> None:
    open_page.get_by_role("button", name="Hold", exact=True).click()
    open_page.get_by_text("HOLD", exact=True).wait_for()
    open_page.get_by_role("button", name="Resume", exact=True).click()
    wait_until(lambda: "resume: done" in visit.log("view"), what="to go on")
    open_page.get_by_text("balancing", exact=True).wait_for()


def test_buttons_and_keys_have_the_robot_walk(open_page: Any, visit: Visit) -> None:
    open_page.get_by_text("Walk", exact=True).click()
    # At no velocity, so in place: how far it comes is not what is tested here.
    open_page.get_by_text("walk", exact=True).click()
    open_page.get_by_text("walking", exact=True).wait_for()
    open_page.keyboard.press("x")
    open_page.get_by_text("balancing", exact=True).wait_for()
    wait_until(lambda: "walk: over" in visit.log("view"), what="the walk's end")


def test_the_e_stop_stops_the_robot(open_page: Any, visit: Visit) -> None:
    with Bus(
        visit.endpoints, Role.CLIENT, namespace="walker", timeout_s=PATIENCE_S
    ) as bus:
        channel = bus.channel(topic("status").key, depth=4096)
        latest = Latest(channel, RobotStatus)
        wait_until(lambda: latest.poll(), what="any status")
        open_page.get_by_role("button", name="E-STOP").click()
        stopped = wait_until(lambda: _fault(latest.poll()), what="the fault")
    pressed = wait_until(
        lambda: re.search(r"e-stop: done \(asked at (\d+) ns\)", visit.log("view")),
        what="the page to note it",
    )
    # Both stamps are of this host's one monotonic clock; the robot tells a change of
    # mode at once, the ones after it carry later stamps.
    assert stopped.stamp_ns > int(pressed[1])
    assert stopped.cause is ModeCause.ESTOP
    assert stopped.detail == "e-stop by live-page"
    open_page.get_by_text("FAULT", exact=True).wait_for()


def test_both_sides_have_kept_what_was_asked(visit: Visit) -> None:
    controller = msgspec.json.decode(
        visit.stabilizer.communicate(timeout=PATIENCE_S)[0], type=ControllerResult
    )
    # A slider may tell a value that it has told before once more.
    asked = [change.after for change in controller.settings_changes]
    assert asked
    assert all(after == {"tsid.com_kp": [31.0] * 3} for after in asked)
    visit.robot.terminate()
    plant = msgspec.json.decode(
        visit.robot.communicate(timeout=PATIENCE_S)[0], type=PlantResult
    )
    (push,) = plant.pushes
    assert (push.source, push.force_n) == ("live-page", [120.0, 0.0, 0.0])


def _fault(status: RobotStatus | None) -> RobotStatus | None:
    is_fault = status is not None and status.mode is RobotMode.FAULT
    return status if is_fault else None


def _has_curves(plot: Any) -> bool:
    return coloured_pixels(plot) > CURVE_PIXELS
