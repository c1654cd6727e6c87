"""``surefoot hz``: how regularly channels speak."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.cli.completion import complete_channel
from surefoot.exit_codes import ExitCode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from surefoot.cli.bus.timing import ChannelTiming, TimingMeter
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.client_side.listener import Listener

PIPED_S = 5.0
_REFRESH_S = 0.5
_TAKE_S = 0.1


def hz(
    channels: Annotated[
        list[str] | None,
        typer.Argument(
            help="Names from surefoot topics, or keys; all when left out.",
            autocompletion=complete_channel,
        ),
    ] = None,
    for_s: Annotated[
        float | None,
        typer.Option(
            "--for",
            min=0.1,
            metavar="SECONDS",
            help=f"How long; on a terminal until Ctrl-C, otherwise {PIPED_S:g} s.",
        ),
    ] = None,
    window_s: Annotated[
        float,
        typer.Option(
            "--window",
            min=0.1,
            metavar="SECONDS",
            help="Rate, jitter and delay are over the last so many.",
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

    On a terminal the table is renewed twice a second. Listens only; ends also when
    the robot leaves. Exits with 4 when there is no robot, with 1 when the link to it
    was lost meanwhile, with 130 after Ctrl-C, which leaves the last table.
    """
    from surefoot.cli.bus.timing import TimingMeter, hz_table
    from surefoot.cli.bus.topics import (
        PUBLISHED,
        find_channel,
        same_clock,
        tell_absences,
    )
    from surefoot.cli.console import live_table, print_json, print_note, print_table
    from surefoot.endpoints import choose_endpoints
    from surefoot.robot_io.bus.session import dialed
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.client_side.listener import Listener
    from surefoot.robot_io.robot import load_robot

    model = load_robot(robot, servo_profile=servo_profile)
    chosen = [find_channel(text, model) for text in channels or []] or PUBLISHED
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    has_delay = same_clock(dialed(meeting))
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
            print_note(
                "no delay: stamps are of the robot's clock, which is another host's"
            )
    if listener.lost:
        print_note(
            f"{listener.lost} messages came faster than they were read here, and are "
            "among the gaps"
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
    """Listen until the time is over, somebody asks to stop or the robot leaves."""
    import time

    begin = time.monotonic()
    due = begin

    def told() -> list[ChannelTiming]:
        now_ns = time.monotonic_ns()
        return [meter.timing(now_ns) for meter in meters.values()]

    while not listener.has_left() and not stop.is_set:
        for heard in listener.take(timeout_s=_TAKE_S):
            meters[heard.key].add(heard.data, received_ns=heard.received_ns)
        now = time.monotonic()
        if for_s is not None and now - begin >= for_s:
            break
        if show is not None and now >= due:
            due = now + _REFRESH_S
            show(told())
    return told()
