"""All printing: results on stdout, everything else on stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import msgspec
from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

REFRESH_HZ = 4.0
"""Slow enough not to take a processor from the two that compute."""

_stdout = Console()
_stderr = Console(stderr=True)


def print_error(error: BaseException) -> None:
    """Says what went wrong; the message itself, without decoration or traceback."""
    _stderr.print("[bold red]surefoot:[/]", end=" ")
    _stderr.print(str(error), markup=False, highlight=False, soft_wrap=True)


def print_note(text: str) -> None:
    """Says something in passing, away from the result."""
    _stderr.print(text, markup=False, highlight=False, soft_wrap=True)


def print_table(table: RenderableType) -> None:
    """Prints a result for people."""
    _stdout.print(table)


def print_text(text: str) -> None:
    """Prints a line of a result for people."""
    _stdout.print(text, markup=False, highlight=False, soft_wrap=True)


def print_json(
    value: msgspec.Struct | Sequence[msgspec.Struct | dict[str, object]],
) -> None:
    """Prints a result for scripts: one JSON text on one line, nothing else."""
    sys.stdout.write(msgspec.json.encode(value).decode() + "\n")
    sys.stdout.flush()


@contextmanager
def progress_bar(
    title: str, *, ticks: int, period_s: float
) -> Iterator[Callable[[int], None]]:
    """Shows how far a run is, on a terminal only.

    Args:
        title: what is running.
        ticks: of the whole run.
        period_s: simulated time of a tick.

    Yields:
        A function to be told the present tick.
    """
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[simulated]}"),
        TimeRemainingColumn(),
        console=_stderr,
        refresh_per_second=REFRESH_HZ,
        disable=not _stderr.is_terminal,
        transient=True,
    )
    with bar:
        task = bar.add_task(title, total=ticks, simulated="starting")

        def advance(tick: int) -> None:
            text = f"{tick * period_s:.1f} of {ticks * period_s:g} s"
            bar.update(task, completed=tick, simulated=text)

        yield advance


@contextmanager
def count_bar(
    title: str, *, total: int, done: int, of: str = "runs"
) -> Iterator[Callable[[], None]]:
    """Shows how many of many things are done, and the time left, on a terminal only.

    Args:
        title: what is under way.
        total: of all things.
        done: already, before now.
        of: what the things are called.

    Yields:
        A function to be called after each.
    """
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} {task.fields[of]}"),
        TimeRemainingColumn(),
        console=_stderr,
        refresh_per_second=REFRESH_HZ,
        disable=not _stderr.is_terminal,
        transient=True,
    )
    with bar:
        task = bar.add_task(title, total=total, completed=done, of=of)
        yield lambda: bar.advance(task)
