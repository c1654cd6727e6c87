"""Errors of the command line."""

from __future__ import annotations

from cli.exit_codes import ExitCode


class CliError(RuntimeError):
    """A command cannot do what it was asked for."""


class UsageError(CliError, ValueError):
    """Options contradict each other, or point at something that is not there."""


class EnvironmentFailedError(CliError, OSError):
    """This machine lacks something: a free port, a library, a package."""


class ChildFailedError(CliError):
    """One of the processes of a run failed.

    Attributes:
        exit_code: what this process should exit with.
    """

    def __init__(self, message: str, *, exit_code: ExitCode) -> None:
        """Keeps the exit code beside the message."""
        super().__init__(message)
        self.exit_code = exit_code
