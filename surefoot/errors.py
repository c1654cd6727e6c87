"""Errors of the library, and the exit codes that they and outcomes mean."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from enum import IntEnum
from typing import Any

from surefoot.schemas.reasons import Outcome

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


class ExitCode(IntEnum):
    """What scripts may rely on."""

    OK = 0
    FAILED = 1
    USAGE = 2
    """Wrong usage, or a file that cannot be used."""
    ENVIRONMENT = 3
    """This machine lacks something: a package, a free port, disk space."""
    UNREACHABLE = 4
    """The robot does not answer."""
    FELL = 5
    """The robot fell."""
    INTERRUPTED = 130


def exit_code_for(outcome: Outcome) -> ExitCode:
    """The exit code of a run that went like this."""
    if outcome.is_up:
        return ExitCode.OK
    special = {
        Outcome.FELL: ExitCode.FELL,
        Outcome.INTERRUPTED: ExitCode.INTERRUPTED,
    }
    return special.get(outcome, ExitCode.FAILED)


def exit_code_of(error: BaseException) -> ExitCode | None:
    """Return the exit code of an error.

    Returns:
        Its code; None for an error nobody foresaw, which deserves its traceback.
    """
    from surefoot.robot_io.errors import (
        CertificateError,
        EndpointError,
        LocatorError,
        RobotFileError,
        RobotIoError,
        RobotMismatchError,
        RobotUnreachableError,
        TickFileError,
    )
    from surefoot.schemas.errors import SchemaError
    from surefoot.sim_robot.errors import ScenarioError, SimulationError
    from surefoot.stabilizer.errors import ControllerError

    if isinstance(error, ChildFailedError):
        return ExitCode(error.exit_code)
    if isinstance(error, KeyboardInterrupt):
        return ExitCode.INTERRUPTED
    if isinstance(error, RobotUnreachableError):
        return ExitCode.UNREACHABLE
    if isinstance(error, (UsageError, SchemaError, RobotFileError, ScenarioError)):
        return ExitCode.USAGE
    if isinstance(error, (LocatorError, CertificateError, ControllerError)):
        return ExitCode.USAGE
    if isinstance(error, (RobotMismatchError, TickFileError)):
        return ExitCode.USAGE
    if isinstance(error, EndpointError):
        return ExitCode.ENVIRONMENT
    if isinstance(error, (RobotIoError, SimulationError)):
        return ExitCode.FAILED
    if isinstance(error, (ImportError, OSError)):
        return ExitCode.ENVIRONMENT
    return None


def foreseen(error: BaseException) -> BaseException:
    """Return an error as it is, or what it says of this machine.

    Args:
        error: what ended a command. MuJoCo, which loads its OpenGL at once, fails in
            another way for each value of ``MUJOCO_GL``, and with an error of any type.
    """
    parts = [name for name in sys.modules if name.startswith("mujoco.")]
    if not parts or "mujoco" in sys.modules or exit_code_of(error) is not None:
        return error
    return EnvironmentFailedError(
        f"MuJoCo does not load with MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}: "
        f"{error}; leave it unset, or write egl or osmesa and see surefoot doctor"
    )


def complain(program: Callable[[], object]) -> None:
    """Run the program of a driver; a foreseen error is one line and its exit code."""
    try:
        program()
    except (Exception, KeyboardInterrupt) as error:  # those without a code go on below
        told = foreseen(error)
        code = exit_code_of(told)
        if code is None:
            raise
        print(f"{ERROR_PREFIX} {told}", file=sys.stderr)
        sys.exit(code)
