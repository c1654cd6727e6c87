"""``surefoot record``: the bus of a live robot to a file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode

if TYPE_CHECKING:
    from surefoot.recording.write import McapFile
    from surefoot.robot_io.client_side.read_only_client import Absences


class LogTime(StrEnum):
    """What log times of a record are."""

    STAMPS = "stamps"
    SIMULATED = "simulated"


def record(
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="FILE", help="Record here (.mcap), into a new file."
        ),
    ],
    overwrite: options.OverwriteOption = False,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    raw: Annotated[
        bool,
        typer.Option("--raw", help="Keep the bus's MessagePack bytes, not JSON."),
    ] = False,
    attach: Annotated[
        list[Path] | None,
        typer.Option(
            "--attach", metavar="FILE", help="Keep this file too. May be repeated."
        ),
    ] = None,
    log_time: Annotated[
        LogTime,
        typer.Option(
            "--log-time",
            help="Times in viewers: the senders' stamps, or simulated time, which is "
            "tick times period, for a robot in lockstep.",
        ),
    ] = LogTime.STAMPS,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait", min=0.0, metavar="SECONDS", help="How long to look for the robot."
        ),
    ] = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    as_json: options.JsonOption = False,
    child: options.ChildOption = False,
) -> None:
    """Record everything on a robot's bus, until it leaves or Ctrl-C.

    Listens only; the robot does not wait for it. Exits with 4 when there is no robot,
    with 3 when the file cannot be written, with 1 when the link to the robot was lost
    meanwhile, with 130 after Ctrl-C, which leaves a whole file.
    """
    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.logs import log_note, set_up_logging
    from surefoot.cli.summary import counts_table
    from surefoot.endpoints import choose_endpoints
    from surefoot.errors import UsageError
    from surefoot.processes.child import begin_as_child, report_ready
    from surefoot.recording.attachments import attachments
    from surefoot.recording.record_bus import RING_DEPTH, record_bus
    from surefoot.recording.write import LogTimes, McapFile
    from surefoot.robot_io.bus.stop_request import StopRequest
    from surefoot.robot_io.client_side.observer import ALL_CHANNELS, Observer
    from surefoot.robot_io.robot import load_robot

    set_up_logging("recorder")
    if child:
        begin_as_child()
    if out.suffix != ".mcap" or not out.absolute().parent.is_dir():
        raise UsageError(f"--out {out}: expected a name .mcap in a folder that exists")
    model = load_robot(robot, servo_profile=servo_profile)
    meeting = choose_endpoints(endpoints, listen=[], connect=connect or [])
    kept = attachments(model, attach or [])
    # Status last: whoever receives it has subscribed to all others.
    channels = (*(name for name in ALL_CHANNELS if name != "status"), "status")
    period_ns = round(model.period_s * 1e9) if log_time is LogTime.SIMULATED else None
    stop = StopRequest()
    with Observer(
        model, endpoints=meeting, channels=channels, depth=RING_DEPTH
    ) as observer:
        observer.connect(timeout_s=wait_s)
        with McapFile(
            out,
            channels=channels,
            keys=model.keys,
            attachments=kept,
            raw=raw,
            times=LogTimes(period_ns),
            overwrite=overwrite,
        ) as file:
            log_note(f"records {model.file.name} to {out}")
            record_bus(
                observer,
                file,
                on_ready=report_ready if child else _say_ready,
                stop=stop,
            )
        absences = observer.absences
    _tell(file, absences)
    if as_json:
        print_json(list(file.counts.values()))
    elif not child:
        print_table(counts_table(list(file.counts.values())))
    if stop.is_set:
        raise typer.Exit(ExitCode.INTERRUPTED)
    if absences.times:
        raise typer.Exit(ExitCode.FAILED)


def _tell(file: McapFile, absences: Absences) -> None:
    """Say on stderr what is missing, whatever is printed on stdout."""
    from surefoot.cli.logs import log_note, log_warning
    from surefoot.recording.write import UNREADABLE

    total = sum(count.messages for count in file.counts.values())
    log_note(f"{total} messages in {file.path}")
    for name, count in file.counts.items():
        if count.missing:
            log_warning(
                f"{name}: {count.missing} missing by {count.counted_by}, "
                f"in {count.gaps} places"
            )
        if count.unreadable:
            log_warning(
                f"{name}: {count.unreadable} messages are none of this channel; they "
                f"are kept as they came, on /{name}/{UNREADABLE}"
            )
    if absences.times:
        log_warning(f"{absences}; what was said meanwhile is not in the record")


def _say_ready() -> None:
    from surefoot.cli.logs import log_note

    log_note("ready: what is said from now on is in the record")
