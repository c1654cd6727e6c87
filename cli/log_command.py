"""``surefoot log``: what is in a record, and how to get it out."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from surefoot.cli import options

log = typer.Typer(no_args_is_help=True, help="Look into records, and export them.")
FileArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="A record (.mcap, or .mcap.partial).")
]


class ExportFormat(StrEnum):
    """Formats a record can be exported to."""

    CSV = "csv"
    NPZ = "npz"
    PARQUET = "parquet"


@log.command()
def info(file: FileArgument, as_json: options.JsonOption = False) -> None:
    """Tell what a record holds, and what is missing in it."""
    from surefoot.cli.console import print_json, print_table, print_text
    from surefoot.cli.summary import counts_table
    from surefoot.recording.read import read_record, record_info

    told = record_info(read_record(file))
    if as_json:
        print_json(told)
        return
    span = f"{told.duration_s:.3f} s between first and last stamp"
    print_text(f"{file}: {told.condition}, {span}")
    print_table(counts_table(told.channels))
    print_text("attached: " + (", ".join(told.attachments) or "nothing"))


@log.command()
def export(
    file: FileArgument,
    to: Annotated[
        ExportFormat,
        typer.Option(
            "--format", help="npz: one file. csv and parquet: a file per channel."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="PATH", help="The file (npz), or a folder."),
    ],
) -> None:
    """Write a record in a format of other tools."""
    from surefoot.cli.console import print_note
    from surefoot.recording.export import export_csv, export_npz, export_parquet
    from surefoot.recording.read import read_record

    write = {
        ExportFormat.CSV: export_csv,
        ExportFormat.NPZ: export_npz,
        ExportFormat.PARQUET: export_parquet,
    }[to]
    record = read_record(file)
    for path in write(record, out):
        print_note(f"wrote {path}")
    for name in record.channels:
        lost = record.size(name) - len(record.messages(name))
        if lost:
            words = f"{name}: {lost} of {record.size(name)} messages left out"
            print_note(
                f"{words}; they are not {record.encoding(name)} that can be read"
            )
    if record.is_cut_off or record.damage:
        print_note(f"{file} is {record.condition}; what could be read was written")
