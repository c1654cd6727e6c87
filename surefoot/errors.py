"""Errors of the library; each message says what, got, expected and what to do next."""

from __future__ import annotations

ERROR_PREFIX = "surefoot:"
"""What every error of a command begins with; a parent finds its children's by it."""


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

    def __init__(self, message: str, *, exit_code: int) -> None:
        """Keep the exit code beside the message."""
        super().__init__(message)
        self.exit_code = exit_code
