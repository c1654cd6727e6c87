"""``surefoot topics``, ``echo`` and ``hz``: messages of a bus and their timing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.cli.options import complete_channel
from surefoot.errors import ExitCode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from surefoot.cli.bus_messages import ChannelTiming, Echo, TimingMeter
    from surefoot.robot_io.client_side.listener import Listener, RawMessage
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.schemas.topics import Topic
SILENT_S = 3.0
"""Silence after which a channel is reported as silent [s]."""
_TAKE_S = 0.2
"""Longest wait for messages before the robot is looked for again [s]."""
PIPED_S = 5.0
"""Time that ``hz`` measures for without a terminal [s]."""
_REFRESH_S = 0.5
_GATHER_S = 0.1


def topics(
    for_s: Annotated[
        float,
        typer.Option(
            "--for",
            min=0.1,
            metavar="SECONDS",
            help="How long rates are measured for.",
        ),
    ] = 1.0,
    as_json: options.JsonOption = False,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
) -> None:
    """List the channels of a robot's bus: type, publishers, subscribers, rate.

    Also lists keys that are no channel of this robot. This command only listens. Exits
    with 4 when there is no robot, with 1 when the link to it was lost meanwhile.
    """
    from surefoot.cli.bus_topics import (
        list_topics,
        tell_absences,
        topics_table,
        unknown_table,
    )
    from surefoot.cli.console import print_json, print_note, print_table, print_text
    from surefoot.robot_io.client_side.listener import Listener

    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
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
        print_text(f"on the bus: {', '.join(told.processes) or 'unknown'}")
    for row in told.channels:
        if row.malformed:
            print_note(
                f"{row.channel}: {row.malformed} of {row.messages} malformed; the "
                f"last: {row.malformed_reason}"
            )
    if not graph.is_told:
        print_note("the access control of the bus hides who publishes and subscribes")
    tell_absences(listener.absences)


def _hear(listener: Listener, for_s: float) -> tuple[list[RawMessage], float]:
    """Return all messages from the first one on, with the time listened [s].

    That time is at most ``for_s``.
    """
    import time

    # The robot begins to send some milliseconds from now, when it knows of us.
    heard = listener.take(timeout_s=for_s)
    begin = time.monotonic()
    end = begin + for_s
    while (left := end - time.monotonic()) > 0.0 and not listener.has_left():
        heard += listener.take(timeout_s=left)
    return heard, time.monotonic() - begin


def echo(
    channel: Annotated[
        str,
        typer.Argument(
            help="A name from surefoot topics, or a key.",
            autocompletion=complete_channel,
        ),
    ],
    fields: Annotated[
        list[str] | None,
        typer.Option(
            "--field",
            metavar="PATH",
            help="Show only this field, such as q.0. May be repeated.",
        ),
    ] = None,
    count: Annotated[
        int | None,
        typer.Option("--count", min=1, help="End after this many messages."),
    ] = None,
    rate_hz: Annotated[
        float | None,
        typer.Option(
            "--rate", min=0.001, metavar="HZ", help="Show at most this many per second."
        ),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print each message as one line of JSON."),
    ] = False,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
) -> None:
    """Print the messages of a channel, until the robot leaves or Ctrl-C.

    This command only listens. A malformed message is shown as such, with the reason.
    Exits with 4 when there is no robot, or when it leaves before --count messages, and
    with 1 when the link to it was lost meanwhile.
    """
    from surefoot.cli.bus_messages import Echo, check_fields
    from surefoot.cli.bus_topics import find_channel, tell_absences
    from surefoot.robot_io.client_side.listener import Listener

    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    entry = find_channel(channel, model)
    check_fields(fields or [], entry.message)
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
        has_left = listener.has_left()  # before taking: its last messages count
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
                f"nothing on {entry.name} for {SILENT_S:g} s (its rate: {entry.rate}); "
                "surefoot topics shows who publishes; Ctrl-C ends"
            )


def hz(
    channels: Annotated[
        list[str] | None,
        typer.Argument(
            help="Names from surefoot topics, or keys; all when absent.",
            autocompletion=complete_channel,
        ),
    ] = None,
    for_s: Annotated[
        float | None,
        typer.Option(
            "--for",
            min=0.1,
            metavar="SECONDS",
            help="How long to measure. Without it: until Ctrl-C on a terminal, "
            f"{PIPED_S:g} s otherwise.",
        ),
    ] = None,
    window_s: Annotated[
        float,
        typer.Option(
            "--window",
            min=0.1,
            metavar="SECONDS",
            help="Rate, jitter and delay are taken over the last so many seconds.",
        ),
    ] = 10.0,
    as_json: options.JsonOption = False,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
) -> None:
    """Measure rate, jitter, gaps and delay of channels.

    On a terminal the table is updated twice a second. This command only listens, and
    ends when the robot leaves. Exits with 4 when there is no robot, with 1 when the
    link to it was lost meanwhile, with 130 after Ctrl-C, which leaves the last table.
    """
    from surefoot.cli.bus_messages import TimingMeter, hz_table
    from surefoot.cli.bus_topics import find_channel, tell_absences
    from surefoot.cli.console import live_table, print_json, print_note, print_table
    from surefoot.robot_io.bus.session import dialed
    from surefoot.robot_io.client_side.listener import Listener
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.robot_io.security.locators import is_local
    from surefoot.schemas.topics import PUBLISHED

    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    chosen = [find_channel(text, model) for text in channels or []] or PUBLISHED
    has_delay = all(map(is_local, dialed(meeting)))  # clocks agree on one host only
    meters = {
        f"{model.file.namespace}/{model.keys[entry.name]}": TimingMeter(
            entry.name,
            every_tick=entry.rate == "every tick",
            window_s=window_s,
            has_delay=has_delay,
        )
        for entry in chosen
    }
    patterns = [model.keys[entry.name] for entry in chosen]
    stop = StopRequest()
    with Listener(model, endpoints=meeting, patterns=patterns) as listener:
        listener.connect(timeout_s=wait_s)
        with live_table(enabled=not as_json) as show, stop.on_signals():
            if for_s is None and show is None:
                for_s = PIPED_S
            timings = _measure(
                listener,
                meters,
                stop=stop,
                for_s=for_s,
                show=None if show is None else lambda told: show(hz_table(told)),
            )
    if as_json:
        print_json(timings)
    else:
        print_table(hz_table(timings))
        if not has_delay:
            print_note("no delay: the stamps are of another host's clock")
    if listener.lost:
        print_note(
            f"{listener.lost} messages came faster than this command reads, and "
            "count among the gaps"
        )
    if stop.is_set:
        raise typer.Exit(ExitCode.INTERRUPTED)
    tell_absences(listener.absences)


def _measure(
    listener: Listener,
    meters: dict[str, TimingMeter],
    *,
    stop: StopRequest,
    for_s: float | None,
    show: Callable[[Iterable[ChannelTiming]], None] | None,
) -> list[ChannelTiming]:
    """Listen until the time is over, a stop is requested or the robot leaves."""
    import time

    begin = time.monotonic()
    due = begin

    def told() -> list[ChannelTiming]:
        now_ns = time.monotonic_ns()
        return [meter.timing(now_ns) for meter in meters.values()]

    while not listener.has_left() and not stop.is_set:
        for heard in listener.take(timeout_s=_GATHER_S):
            meters[heard.key].add(heard.data, received_ns=heard.received_ns)
        now = time.monotonic()
        if for_s is not None and now - begin >= for_s:
            break
        if show is not None and now >= due:
            due = now + _REFRESH_S
            show(told())
    return told()
