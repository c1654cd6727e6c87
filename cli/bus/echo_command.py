"""``surefoot echo``: what is said on a channel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.cli.completion import complete_channel
from surefoot.exit_codes import ExitCode

if TYPE_CHECKING:
    from surefoot.cli.bus.echo import Echo
    from surefoot.robot_io.client_side.listener import Listener
    from surefoot.schemas.topics import Topic

SILENT_S = 3.0
"""Silence after which a channel is reported as silent [s]."""
_TAKE_S = 0.2


def echo(
    channel: Annotated[
        str,
        typer.Argument(
            help="Name from surefoot topics, or a key.",
            autocompletion=complete_channel,
        ),
    ],
    fields: Annotated[
        list[str] | None,
        typer.Option(
            "--field", metavar="PATH", help="Only this, such as q.0. May be repeated."
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option("--count", min=1, help="End after so many messages.")
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option("--rate", min=0.001, metavar="HZ", help="Show at most so many."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object a message and line.")
    ] = False,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
) -> None:
    """Print the messages of a channel, until the robot leaves or Ctrl-C.

    Listens only. A malformed message is shown as such, with the reason. Exits with 4
    when there is no robot, or it leaves before --count messages, with 1 when the link
    to it was lost meanwhile.
    """
    from surefoot.cli.bus.echo import Echo, check_fields
    from surefoot.cli.bus.topics import find_channel, tell_absences
    from surefoot.endpoints import choose_endpoints
    from surefoot.robot_io.client_side.listener import Listener
    from surefoot.robot_io.robot import load_robot

    model = load_robot(robot, servo_profile=servo_profile)
    entry = find_channel(channel, model)
    check_fields(fields or [], entry.message)
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    shown = Echo(
        entry,
        joint_count=model.n_a,
        fields=fields or [],
        rate_hz=rate_hz,
        as_json=as_json,
    )
    patterns = [model.keys[entry.name]]
    with Listener(model, endpoints=meeting, patterns=patterns) as listener:
        listener.connect(timeout_s=wait_s)
        _show(listener, shown, entry, count=count)
    if count is not None and shown.count < count:
        from surefoot.cli.console import print_note

        print_note(f"the robot left after {shown.count} of {count} messages")
        raise typer.Exit(ExitCode.UNREACHABLE)
    tell_absences(listener.absences)


def _show(listener: Listener, shown: Echo, entry: Topic, *, count: int | None) -> None:
    import time

    from surefoot.cli.console import print_note, print_text

    said_since = time.monotonic()
    is_told = False
    while True:
        has_left = listener.has_left()  # asked first: then what it said last is heard
        for heard in listener.take(timeout_s=_TAKE_S):
            said_since = time.monotonic()
            for line in shown.lines(heard):
                print_text(line)
            if count is not None and shown.count >= count:
                return
        if has_left:
            return
        if not is_told and time.monotonic() - said_since > SILENT_S:
            is_told = True
            print_note(
                f"nothing on {entry.name} for {SILENT_S:g} s (it speaks {entry.rate}); "
                "surefoot topics tells who publishes; Ctrl-C ends"
            )
