"""``surefoot log``: what is in a record, and how to get it out."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options

if TYPE_CHECKING:
    from surefoot.recording.read import Record

log = typer.Typer(
    name="log",
    cls=options.Group,
    no_args_is_help=True,
    help="Look into records, and export them.",
)
FileArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="A record (.mcap, or .mcap.partial), or the folder of a run for its "
        "signals at every tick.",
    ),
]


class ExportFormat(StrEnum):
    """Formats a record can be exported to."""

    CSV = "csv"
    NPZ = "npz"
    PARQUET = "parquet"


@log.command(cls=options.Command)
def info(file: FileArgument, as_json: options.JsonOption = False) -> None:
    """Tell what a record or a run holds, and what is missing in it."""
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
    whole = "cut off; all that is whole of it is told" if told.is_cut_off else "whole"
    lost = f", {told.lost_ticks} not recorded" if told.lost_ticks else ""
    print_text(f"{place}: {whole}, {told.ticks} ticks{lost}\n\n{signals.describe()}")


@log.command(cls=options.Command)
def export(
    file: FileArgument,
    to: Annotated[
        ExportFormat,
        typer.Option(
            "--format",
            help="npz: one file. csv and parquet: a file per channel, or one for the "
            "signals of a run.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="PATH", help="The file (npz), or a folder."),
    ],
    overwrite: options.OverwriteOption = False,
) -> None:
    """Write a record, or the signals of a run, in a format of other tools."""
    from surefoot.cli.console import print_note
    from surefoot.recording import export
    from surefoot.recording.read import read_record
    from surefoot.signals import holds_signals, read_signals

    if holds_signals(file):
        signals = read_signals(file)
        written = {
            ExportFormat.CSV: export.export_signals_csv,
            ExportFormat.NPZ: export.export_signals_npz,
            ExportFormat.PARQUET: export.export_signals_parquet,
        }[to](signals, out, overwrite=overwrite)
        left_out = [_CUT_OFF.format(file)] if signals.is_cut_off else []
    else:
        record = read_record(file)
        written = {
            ExportFormat.CSV: export.export_csv,
            ExportFormat.NPZ: export.export_npz,
            ExportFormat.PARQUET: export.export_parquet,
        }[to](record, out, overwrite=overwrite)
        left_out = _left_out(record)
    for path in written:
        print_note(f"wrote {path}")
    for note in left_out:
        print_note(note)


_CUT_OFF = "{} is cut off; what is whole of it was written"


def _left_out(record: Record) -> list[str]:
    """What of a record is not in its export, in words."""
    notes = []
    for name in record.channels:
        size = record.size(name)
        lost = size - len(record.messages(name))
        if lost:
            notes.append(
                f"{name}: {lost} of {size} messages left out; they are not "
                f"{record.encoding(name)} that can be read"
            )
    if record.is_cut_off or record.damage:
        notes.append(
            f"{record.path} is {record.condition}; what could be read was written"
        )
    return notes
