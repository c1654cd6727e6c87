"""Runs ``surefoot`` commands in this process, so that a thousand take minutes."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from typing import NamedTuple

import typer

from surefoot.cli import console
from surefoot.cli.app import app
from surefoot.errors import exit_code_of


class Outcome(NamedTuple):
    """The end of a command.

    Attributes:
        code: exit code.
        error: error message; empty without one.
    """

    code: int
    error: str


def run_here(*arguments: object) -> Outcome:
    """Run a command; an unexpected error fails the test."""
    with _silent():
        try:
            code = app(list(map(str, arguments)), standalone_mode=False)
        except typer.Exit as end:
            return Outcome(end.exit_code, "")
        except Exception as error:
            known = exit_code_of(error)
            if known is None:
                raise
            return Outcome(int(known), console._words(error))
    return Outcome(int(code or 0), "")


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    # Not what `file` gives: that is the present stream, which is gone in the next test.
    out, err = console._stdout._file, console._stderr._file
    console._stdout.file = console._stderr.file = io.StringIO()
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        console._stdout._file, console._stderr._file = out, err


def assert_refused_in_one_line(outcome: Outcome, name: str) -> None:
    """Check for exit code 2 and a single line that names the file."""
    assert outcome.code == 2, outcome
    assert "\n" not in outcome.error.strip(), outcome
    assert name in outcome.error, outcome
