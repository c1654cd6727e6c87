"""``surefoot replay``: plays a record on the bus, or computes its commands again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.cli.options import complete_controller
from surefoot.errors import ExitCode, UsageError

if TYPE_CHECKING:
    from surefoot.playback.timeline import Timeline
    from surefoot.robot_io.robot import Robot
    from surefoot.schemas.endpoints import Endpoints

_PLAYING = "Playing on the bus"


def replay(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A record (.mcap, or .mcap.partial).")
    ],
    controller: Annotated[
        bool,
        typer.Option(
            "--controller",
            help="Compute the commands again from the recorded sensors, and compare.",
        ),
    ] = False,
    speed: Annotated[
        float,
        typer.Option(
            "--speed",
            min=0.001,
            metavar="X",
            help="Seconds of the record per second.",
            rich_help_panel=_PLAYING,
        ),
    ] = 1.0,
    loop: Annotated[
        bool,
        typer.Option(
            "--loop",
            help="Start again from the beginning at the end.",
            rich_help_panel=_PLAYING,
        ),
    ] = False,
    now: Annotated[
        bool,
        typer.Option(
            "--now",
            help="Begin at once, without waiting for a subscriber.",
            rich_help_panel=_PLAYING,
        ),
    ] = False,
    from_s: Annotated[
        float,
        typer.Option(
            "--from",
            min=0.0,
            metavar="SECONDS",
            help="Begin this long after the first tick.",
            rich_help_panel=_PLAYING,
        ),
    ] = 0.0,
    until_s: Annotated[
        float | None,
        typer.Option(
            "--until",
            min=0.0,
            metavar="SECONDS",
            help="End this long after the first tick.",
        ),
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            "--robot",
            help="Robot to use instead of the one attached to the record.",
        ),
    ] = None,
    law: Annotated[
        str | None,
        typer.Option(
            "--law",
            metavar="NAME",
            help="Control law to use instead of the recorded one; as for `run`.",
            autocompletion=complete_controller,
            rich_help_panel=options.CONTROLLER,
        ),
    ] = None,
    settings: options.SettingsOption = None,
    overrides: options.SetOption = None,
    as_json: options.JsonOption = False,
    endpoints: options.EndpointsOption = None,
    listen: options.ListenOption = None,
    router: options.RouterOption = None,
    insecure: options.InsecureOption = False,
) -> None:
    """Play a record on the bus, or compute its commands again.

    On the bus the record looks like the robot, for surefoot view and record, and
    refuses commands. With --controller no bus is used: exits with 0 when all commands
    are the same bit for bit, and with 1 when they differ. Control law and settings are
    the recorded ones unless given. The whole record is read into memory.
    """
    from surefoot.playback.timeline import read_timeline, recorded_robot

    bus = bool(loop or now or from_s or speed != 1.0 or endpoints or listen or router)
    tuned = bool(law or settings or overrides or as_json)
    if controller and bus:
        raise UsageError(
            "--controller uses no bus and begins at the first tick; leave out --speed, "
            "--loop, --now, --from, --endpoints, --listen and --router"
        )
    if not controller and tuned:
        raise UsageError("--law, --settings, --set and --json need --controller")
    timeline = read_timeline(file)
    with recorded_robot(timeline.record, robot) as model:
        if controller:
            _check(
                timeline,
                model,
                file=file,
                law=law,
                settings=settings,
                overrides=overrides or [],
                until_s=until_s,
                as_json=as_json,
            )
            return
        from surefoot.schemas.endpoints import choose_endpoints

        meeting = choose_endpoints(
            endpoints, listen=listen, router=router, insecure=insecure
        )
        _play(
            timeline,
            model,
            meeting,
            file=file,
            speed=speed,
            loop=loop,
            now=now,
            span=(from_s, until_s),
        )


def _check(
    timeline: Timeline,
    robot: Robot,
    *,
    file: Path,
    law: str | None,
    settings: Path | None,
    overrides: list[str],
    until_s: float | None,
    as_json: bool,
) -> None:
    from surefoot.cli.console import (
        print_json,
        print_note,
        print_table,
        print_text,
        progress_bar,
    )
    from surefoot.cli.summary import outcome_table, verdict
    from surefoot.playback.check import check, recorded_settings
    from surefoot.run_plan import resolve_settings

    resolved = (
        recorded_settings(timeline, overrides)
        if settings is None
        else resolve_settings(settings, overrides=overrides, reader=law)
    )
    first = timeline.first_tick
    with progress_bar(
        file.name, ticks=timeline.last_tick + 1 - first, period_s=robot.period_s
    ) as on_tick:
        outcome = check(
            timeline,
            robot,
            resolved,
            file=file,
            law=law,
            overrides=overrides,
            until_s=until_s,
            on_tick=lambda tick: on_tick(tick - first),
        )
    for note in outcome.notes:
        print_note(f"note: {note}")
    if as_json:
        print_json(outcome)
    else:
        print_table(outcome_table(outcome))
        print_text(verdict(outcome))
    if not outcome.is_equal:
        raise typer.Exit(ExitCode.FAILED)


def _play(
    timeline: Timeline,
    robot: Robot,
    meeting: Endpoints,
    *,
    file: Path,
    speed: float,
    loop: bool,
    now: bool,
    span: tuple[float, float | None],
) -> None:
    from surefoot.cli.console import progress_bar
    from surefoot.playback.timeline import between, play
    from surefoot.processes.child import begin_process, log_note
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.robot_io.robot_side.replay_server import ReplayServer

    begin_process("replay")
    period_s = robot.period_s
    entries = between(timeline, period_s=period_s, from_s=span[0], until_s=span[1])
    if not entries:
        until = "its end" if span[1] is None else f"--until {span[1]:g}"
        raise UsageError(
            f"{file}: nothing between --from {span[0]:g} and {until}; expected seconds "
            f"from its first tick, {timeline.first_tick}, the last is "
            f"{timeline.last_tick}, at {1.0 / period_s:g} Hz"
        )
    first = entries[0].tick
    where = ", ".join(meeting.router or meeting.listen)
    stop = StopRequest()
    with (
        stop.on_signals(),
        ReplayServer(robot, endpoints=meeting, stop=stop) as server,
    ):
        if not now:
            log_note(f"waits at {where} for somebody to subscribe (surefoot view)")
            server.wait_for_audience()
        again = True
        while again and not stop.is_set:
            log_note(f"plays {file} as {robot.file.name} at {where}, {speed:g} x")
            with progress_bar(
                file.name, ticks=entries[-1].tick + 1 - first, period_s=period_s
            ) as on_tick:
                counts = play(
                    entries,
                    server,
                    raw=timeline.record.is_raw,
                    tick_s=period_s / speed,
                    stop=stop,
                    on_tick=lambda tick: on_tick(tick - first),
                )
            log_note(f"{sum(counts.values())} messages played")
            again = loop
    if stop.is_set:
        raise typer.Exit(ExitCode.INTERRUPTED)
