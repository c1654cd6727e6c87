"""``surefoot topics``: what is on the bus, and who says it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options

if TYPE_CHECKING:
    from surefoot.robot_io.client_side.listener import Listener, RawMessage


def topics(
    for_s: Annotated[
        float,
        typer.Option(
            "--for", min=0.1, metavar="SECONDS", help="How long rates are measured."
        ),
    ] = 1.0,
    as_json: options.JsonOption = False,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
) -> None:
    """List the channels of a robot's bus: type, who speaks and listens, rate.

    Keys that are no channel of this robot are listed too. Listens only. Exits with 4
    when there is no robot, with 1 when the link to it was lost meanwhile.
    """
    from surefoot.cli.bus.topics import (
        list_topics,
        tell_absences,
        topics_table,
        unknown_table,
    )
    from surefoot.cli.console import print_json, print_note, print_table, print_text
    from surefoot.endpoints import choose_endpoints
    from surefoot.robot_io.client_side.listener import Listener
    from surefoot.robot_io.robot import load_robot

    model = load_robot(robot, servo_profile=servo_profile)
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    with Listener(
        model, endpoints=meeting, patterns=["**"], elsewhere=True
    ) as listener:
        listener.connect(timeout_s=wait_s)
        heard, listened_s = _hear(listener, for_s)
        graph = listener.bus_graph()
    told = list_topics(model, heard, graph, listened_s=listened_s)
    if as_json:
        print_json(told)
    else:
        print_table(topics_table(told))
        if told.unknown:
            print_table(unknown_table(told))
        print_text(f"on the bus: {', '.join(told.processes) or 'nobody tells'}")
    for row in told.channels:
        if row.malformed:
            print_note(
                f"{row.channel}: {row.malformed} of {row.messages} malformed; the "
                f"last: {row.malformed_reason}"
            )
    if not graph.is_told:
        print_note(
            "who publishes and subscribes is not told here: the access control of "
            "the bus keeps it"
        )
    tell_absences(listener.absences)


def _hear(listener: Listener, for_s: float) -> tuple[list[RawMessage], float]:
    """Return all that is heard from the first message on, at most ``for_s`` long."""
    import time

    # The robot begins to send once it knows of us, some milliseconds from now.
    heard = listener.take(timeout_s=for_s)
    begin = time.monotonic()
    end = begin + for_s
    while (left := end - time.monotonic()) > 0.0 and not listener.has_left():
        heard += listener.take(timeout_s=left)
    return heard, time.monotonic() - begin
