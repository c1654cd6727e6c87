"""``surefoot record`` and ``log``: records of the bus and their contents."""

from __future__ import annotations

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode

if TYPE_CHECKING:
    from surefoot.recording.read import Record
    from surefoot.recording.write import McapFile
    from surefoot.robot_io.client_side.robot_watch import Absences
_READY = "ready: what is said from now on is in the record"


class LogTime(StrEnum):
    """What the log times of a record are."""

    STAMPS = "stamps"
    SIMULATED = "simulated"


def record(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="FILE", help="New file for the record (.mcap)."),
    ],
    overwrite: options.OverwriteOption = False,
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    raw: Annotated[
        bool,
        typer.Option("--raw", help="Keep the bus's MessagePack bytes instead of JSON."),
    ] = False,
    attach: Annotated[
        list[Path] | None,
        typer.Option(
            "--attach",
            metavar="FILE",
            help="Attach this file to the record. May be repeated.",
        ),
    ] = None,
    log_time: Annotated[
        LogTime,
        typer.Option(
            "--log-time",
            help="Times that viewers show: the senders' stamps, or simulated time "
            "(tick times period), for a robot in lockstep.",
        ),
    ] = LogTime.STAMPS,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    cpu: options.CpuOption = None,
    realtime_priority: options.PriorityOption = None,
    as_json: options.JsonOption = False,
    child: options.ChildOption = False,
) -> None:
    """Record everything on a robot's bus, until it leaves or Ctrl-C.

    This command only listens; the robot does not wait for it. Exits with 4 when there
    is no robot, with 3 when the file cannot be written, with 1 when the link to the
    robot was lost meanwhile, with 130 after Ctrl-C, which leaves a complete file.
    """
    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.summary import counts_table
    from surefoot.errors import UsageError
    from surefoot.processes.child import begin_process, log_note, report_ready
    from surefoot.recording.contents import RING_DEPTH, attachments, record_bus
    from surefoot.recording.write import LogTimes, McapFile
    from surefoot.robot_io.client_side.observer import Observer
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.schemas.topics import ALL_CHANNELS

    begin_process("recorder", child=child)
    if out.suffix != ".mcap" or not out.absolute().parent.is_dir():
        raise UsageError(f"--out {out}: expected a name .mcap in a folder that exists")
    options.claim_processor(cpu=cpu, priority=realtime_priority)
    model, meeting = options.dialed(robot, servo_profile, endpoints, connect)
    kept = attachments(model, attach or [])
    # Status is last: a process that receives it has subscribed to all the others.
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
                on_ready=report_ready if child else partial(log_note, _READY),
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
    """Warn on stderr of what is missing in the record."""
    from surefoot.processes.child import log_note, log_warning
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
                f"{name}: {count.unreadable} messages do not fit this channel and are "
                f"kept as bytes on /{name}/{UNREADABLE}"
            )
    if absences.times:
        log_warning(f"{absences}; messages of that time are not in the record")


log = typer.Typer(
    name="log",
    cls=options.Group,
    no_args_is_help=True,
    help="Contents of records, and their export.",
)
FileArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="A record (.mcap, or .mcap.partial), or a run's folder for its signals "
        "at every tick.",
    ),
]


class ExportFormat(StrEnum):
    """Formats of an export."""

    CSV = "csv"
    NPZ = "npz"
    PARQUET = "parquet"


@log.command(cls=options.Command)
def info(file: FileArgument, as_json: options.JsonOption = False) -> None:
    """Show what a record or a run holds, and what is missing in it."""
    from surefoot.cli.console import print_json, print_table, print_text
    from surefoot.cli.summary import counts_table
    from surefoot.recording.read import read_record, record_info
    from surefoot.signals import holds_signals

    if holds_signals(file):
        _tell_signals(file, as_json=as_json)
        return
    told = record_info(read_record(file))
    if as_json:
        print_json(told)
        return
    span = f"{told.duration_s:.3f} s between first and last stamp"
    print_text(f"{file}: {told.condition}, {span}")
    print_table(counts_table(told.channels))
    print_text("attached: " + (", ".join(told.attachments) or "nothing"))


def _tell_signals(place: Path, *, as_json: bool) -> None:
    from surefoot.cli.console import print_json, print_text
    from surefoot.signals import read_signals, signals_info

    signals = read_signals(place)
    told = signals_info(signals)
    if as_json:
        print_json(told)
        return
    whole = "cut off or damaged" if told.gaps else "whole"
    lost = f", {told.lost_ticks} not recorded" if told.lost_ticks else ""
    print_text(f"{place}: {whole}, {told.ticks} ticks{lost}\n\n{signals.describe()}")


@log.command(cls=options.Command)
def export(
    file: FileArgument,
    to: Annotated[
        ExportFormat,
        typer.Option(
            "--format",
            help="npz writes one file. csv and parquet write a file per channel of a "
            "record, or one for the signals of a run.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="PATH", help="File for npz, folder otherwise."),
    ],
    overwrite: options.OverwriteOption = False,
) -> None:
    """Convert a record, or the signals of a run, for other tools."""
    from surefoot.cli.console import print_note
    from surefoot.recording.export import export_record, export_signals
    from surefoot.recording.read import read_record
    from surefoot.signals import holds_signals, read_signals

    if holds_signals(file):
        signals = read_signals(file)
        written = export_signals(signals, to.value, out, overwrite=overwrite)
        left_out = []
    else:
        record = read_record(file)
        written = export_record(record, to.value, out, overwrite=overwrite)
        left_out = _left_out(record)
    for path in written:
        print_note(f"wrote {path}")
    for note in left_out:
        print_note(note)


def _left_out(record: Record) -> list[str]:
    """Return notes on what an export lacks of its record."""
    notes = []
    for name in record.channels:
        size = record.size(name)
        lost = size - sum(1 for _ in record.each(name))
        if lost:
            notes.append(
                f"{name}: {lost} of {size} messages left out; they are not valid "
                f"{record.encoding(name)}"
            )
    if record.is_cut_off or record.damage:
        notes.append(
            f"{record.path} is {record.condition}; what could be read was written"
        )
    return notes
