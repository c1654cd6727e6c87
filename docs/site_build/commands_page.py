"""Reference of all commands, from the command line itself."""

from __future__ import annotations

import re

import typer
from typer.cli import get_docs_for_click
from typer.main import get_command

from surefoot.cli.app import app
from surefoot.errors import ExitCode

_NAME = "surefoot"
_CODES = {
    ExitCode.OK: "done as asked",
    ExitCode.FAILED: "a process, a request or a check failed",
    ExitCode.USAGE: "wrong usage, or a file that cannot be used",
    ExitCode.ENVIRONMENT: "this machine lacks something: a package, a port, disk space",
    ExitCode.UNREACHABLE: "the robot does not answer",
    ExitCode.FELL: "the robot fell",
    ExitCode.INTERRUPTED: "Ctrl-C",
}


def commands_page() -> str:
    """Markdown of every command with its arguments, options and defaults."""
    command = get_command(app)
    context = typer.Context(command, info_name=_NAME)
    body = get_docs_for_click(obj=command, ctx=context, name=_NAME)
    _, _, rest = body.partition("\n")
    for name, child in getattr(command, "commands", {}).items():
        rest = re.sub(rf"(?m)^\* `{name}`: .*$", _entry(name, child.help), rest)
    codes = "".join(f"| {int(code)} | {text} |\n" for code, text in _CODES.items())
    return (
        "# Commands\n\nWritten from the command line itself; `surefoot COMMAND --help` "
        "says the same. With `--json`, stdout is one JSON object and nothing else.\n\n"
        f"| exit code | means |\n|---|---|\n{codes}\n## `{_NAME}`\n{rest}"
    )


def _entry(name: str, help_text: str | None) -> str:
    """A line of the list of commands, whole and with a link."""
    words = " ".join((help_text or "").split("\n\n")[0].split())
    return f"* [`{name}`](#{_NAME}-{name}): {words}"
