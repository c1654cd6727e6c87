"""Errors of the library; each message says what, got, expected and what to do next."""

from __future__ import annotations

from typing import Any

ERROR_PREFIX = "surefoot:"
"""What every error of a command begins with; a parent finds its children's by it."""


class SurefootError(RuntimeError):
    """Base of the library's own errors: it cannot do what it was asked for."""


class UsageError(SurefootError, ValueError):
    """Options contradict each other, or point at something that is not there."""


class UnknownSignalError(UsageError, KeyError):
    """A run has no signal of this name."""

    def __str__(self) -> str:
        """The message as it is; a KeyError would put it in quotes."""
        return str(self.args[0])


class EnvironmentFailedError(SurefootError, OSError):
    """This machine lacks something: a free port, a library, a package."""


class ChildFailedError(SurefootError):
    """One of the processes of a run failed.

    Attributes:
        exit_code: what this process should exit with.
        run: what there is of the run, a :class:`surefoot.Run`; None for nothing.
    """

    run: Any = None

    def __init__(self, message: str, *, exit_code: int) -> None:
        """Keep the exit code beside the message."""
        super().__init__(message)
        self.exit_code = exit_code


class TuneInterrupted(KeyboardInterrupt):
    """A search was ended by Ctrl-C or SIGTERM.

    Attributes:
        tuned: what there is of it, a :class:`surefoot.Tuned`; None for nothing.
    """

    def __init__(self, tuned: Any) -> None:
        """Keep what there is of the search."""
        super().__init__("the search was interrupted")
        self.tuned = tuned


class RunInterrupted(KeyboardInterrupt):
    """A run was ended by Ctrl-C or SIGTERM.

    Attributes:
        run: what there is of it, a :class:`surefoot.Run` with the outcome
            ``interrupted``; None for nothing.
    """

    def __init__(self, run: Any) -> None:
        """Keep what there is of the run."""
        super().__init__("the run was interrupted")
        self.run = run
