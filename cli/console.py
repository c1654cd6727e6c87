"""All printing: results on stdout, everything else on stderr."""

from __future__ import annotations

import errno
import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import msgspec
from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from surefoot.errors import ERROR_PREFIX
from surefoot.installation import install_command
from surefoot.out_folder import json_bytes

REFRESH_HZ = 4.0
"""Low, since robot and stabilizer need the processor."""

WIDE = 200
"""Columns where output goes to a pipe or a file, which has no width of its own."""


PLAIN: dict[str, Any] = {"markup": False, "emoji": False}
"""A unit, [m], or a name that somebody chose is text, not how to print it."""


def _console_for_results() -> Console:
    console = Console(**PLAIN)
    if console.is_terminal or "COLUMNS" in os.environ:
        return console
    return Console(width=WIDE, **PLAIN)


_stdout = _console_for_results()
_stderr = Console(stderr=True, **PLAIN)


def print_error(error: BaseException) -> None:
    """Print an error's message to stderr, without a traceback."""
    _stderr.print(ERROR_PREFIX, style="bold red", end=" ")
    _stderr.print(_words(error), highlight=False, soft_wrap=True)


def print_note(text: str) -> None:
    """Print a remark to stderr, apart from the result."""
    _stderr.print(text, highlight=False, soft_wrap=True)


class NoteHandler(logging.Handler):
    """Prints log records of the library as notes."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        print_note(self.format(record))


def show_notes(logger: str) -> None:
    """Print what one logger of the library logs from now on."""
    log = logging.getLogger(logger)
    log.setLevel(logging.INFO)
    log.handlers[:] = [NoteHandler()]
    log.propagate = False


def print_table(table: RenderableType) -> None:
    """Print a result for people."""
    _stdout.print(table)


def new_table(
    title: str, *words: str, figures: Sequence[str] = (), boxed: bool = True
) -> Table:
    """Return an empty table: left-aligned text columns, then right-aligned figures."""
    table = Table(title=title, title_justify="left", pad_edge=boxed)
    if not boxed:
        table.box = None
    for heading in words:
        table.add_column(heading, overflow="fold")
    for heading in figures:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def print_text(text: str) -> None:
    """Print a line of a result for people."""
    _stdout.print(text, highlight=False, soft_wrap=True)


def verdict_mark(is_good: bool, otherwise: str, *, style: str = "bold red") -> Text:
    """Return a green ``ok``, or what to say instead, in its own style."""
    return Text("ok", "green") if is_good else Text(otherwise, style)


def print_json(
    value: msgspec.Struct | dict[str, Any] | Sequence[msgspec.Struct | dict[str, Any]],
) -> None:
    """Print a result for scripts: one JSON text on one line, nothing else."""
    sys.stdout.flush()
    sys.stdout.buffer.write(json_bytes(value) + b"\n")  # UTF-8, whatever the terminal
    sys.stdout.flush()


def print_result(
    value: msgspec.Struct, table: Callable[[], RenderableType], *, as_json: bool
) -> None:
    """Print a result for scripts, or its table for people."""
    if as_json:
        print_json(value)
    else:
        print_table(table())


@contextmanager
def progress_bar(
    title: str, *, ticks: int, period_s: float
) -> Iterator[Callable[[int], None]]:
    """Show the progress of a run; on a terminal only.

    Yields:
        A function that takes the present tick, counted from 0.
    """
    with _bar(title, total=ticks, words="starting") as update:

        def advance(tick: int) -> None:
            update(tick, f"{tick * period_s:.1f} of {ticks * period_s:g} s")

        yield advance


@contextmanager
def count_bar(
    title: str, *, total: int, done: int, of: str = "runs"
) -> Iterator[Callable[[], None]]:
    """Show how many of ``total`` are done and the time left; on a terminal only.

    Yields:
        A function to call after each one.
    """
    with _bar(title, total=total, words=f"{done} of {total} {of}") as update:
        update(done, f"{done} of {total} {of}")

        def advance() -> None:
            nonlocal done
            done += 1
            update(done, f"{done} of {total} {of}")

        yield advance


@contextmanager
def _bar(title: str, *, total: int, words: str) -> Iterator[Callable[[int, str], None]]:
    """Show a bar on a terminal only; yields a function that sets count and text."""
    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[words]}", markup=False),
        TimeRemainingColumn(),
        console=_stderr,
        refresh_per_second=REFRESH_HZ,
        disable=not _stderr.is_terminal,
        transient=True,
    )
    with bar:
        task = bar.add_task(title, total=total, words=words)
        yield lambda done, told: bar.update(task, completed=done, words=told)


@contextmanager
def live_table(
    *, enabled: bool = True
) -> Iterator[Callable[[RenderableType], None] | None]:
    """Show a table that is updated in place and vanishes; on a terminal only.

    Yields:
        A function that takes the present table; None without a terminal.
    """
    if not enabled or not _stdout.is_terminal:
        yield None
        return
    with Live(console=_stdout, transient=True, auto_refresh=False) as live:
        yield lambda table: live.update(table, refresh=True)


def _words(error: BaseException) -> str:
    """Return an error's message; for a system error its text without the number."""
    if isinstance(error, ImportError):
        return f"{error}; {import_advice(error)}"
    if not isinstance(error, OSError) or type(error).__module__ != "builtins":
        return str(error)
    if error.strerror is None:
        return str(error)
    place = f"{error.filename}: " if error.filename is not None else ""
    hint = _HINTS.get(error.errno or 0, "")
    return f"{place}{error.strerror}{hint}"


def import_advice(error: ImportError) -> str:
    """Return what to install for a system library or package that failed to load."""
    if "shared object" not in str(error):
        return f"install what is missing: {install_command()}"
    return (
        "a library of the system is missing; for libgomp.so.1, on Debian and Ubuntu: "
        "apt-get install libgomp1"
    )


_UNWRITABLE = "; name a folder that can be written to"
_FULL = "; make room, or name a folder on another disk"
_HINTS = {
    errno.ENOSPC: _FULL,
    errno.EDQUOT: _FULL,
    errno.EFBIG: "; allow larger files (ulimit -f), or name a folder on another disk",
    errno.EACCES: _UNWRITABLE,
    errno.EROFS: _UNWRITABLE,
}
