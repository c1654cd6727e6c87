"""Buttons of the live page: e-stop, hold, resume, push."""

from __future__ import annotations

from typing import Any

from cli.view.asker import Asker
from robot_io.robot import Robot

DIRECTIONS = {
    "forward": (1.0, 0.0),
    "back": (-1.0, 0.0),
    "left": (0.0, 1.0),
    "right": (0.0, -1.0),
}
MAX_PUSH_N = 300.0
RED = (216, 54, 66)
GREY = (94, 104, 116)


def add_controls(gui: Any, asker: Asker) -> None:
    """Adds the buttons that stop and start.

    Args:
        gui: ``server.gui`` of viser.
        asker: does what is pressed.
    """
    estop = gui.add_button(
        "E-STOP", color=RED, hint="The robot keeps its posture until it is reset."
    )
    hold = gui.add_button(
        "Hold",
        color=GREY,
        hint="The robot keeps its posture; the stabilizer keeps command.",
    )
    resume = gui.add_button("Resume", color=GREY, hint="Balance again after a hold.")

    # viser gives its decorators no types.
    @estop.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        asker.ask_now("e-stop", lambda requests: requests.stop_robot())

    @hold.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        asker.ask("hold", lambda requests: requests.control("hold"))

    @resume.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        asker.ask("resume", lambda requests: requests.control("resume"))


def add_push(gui: Any, asker: Asker, robot: Robot) -> None:
    """Adds the push, which only a simulated robot can be given.

    Args:
        gui: ``server.gui`` of viser.
        asker: does what is pressed.
        robot: whose base link is pushed.
    """
    with gui.add_folder("Push (simulator only)"):
        force = gui.add_slider(
            "Force [N]", min=10, max=MAX_PUSH_N, step=10, initial_value=120
        )
        duration = gui.add_slider(
            "Duration [s]", min=0.05, max=0.5, step=0.05, initial_value=0.1
        )
        directions = gui.add_button_group("Push", tuple(DIRECTIONS))

    @directions.on_click  # type: ignore[untyped-decorator]
    def _(event: Any) -> None:
        x, y = DIRECTIONS[directions.value]
        newtons, seconds = float(force.value), float(duration.value)
        asker.ask(
            f"push {directions.value}, {newtons:g} N for {seconds:g} s",
            lambda requests: requests.push(
                robot.file.base_link,
                [x * newtons, y * newtons, 0.0],
                duration_s=seconds,
            ),
        )
