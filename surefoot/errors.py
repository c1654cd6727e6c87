"""Errors of the library, and the exit codes of errors and outcomes.

The command line, drivers and scripts use them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from enum import IntEnum
from typing import Any

from surefoot.schemas.reasons import Outcome

ERROR_PREFIX = "surefoot:"
"""Every error of a command begins with it; a parent finds its children's by it."""


class SurefootError(RuntimeError):
    """Base of the library's own errors: it cannot do what was asked."""


class UsageError(SurefootError, ValueError):
    """Options contradict each other, or name something that does not exist."""


class UnknownSignalError(UsageError, KeyError):
    """A run has no signal of this name."""

    def __str__(self) -> str:
        """Return the message as it is; KeyError would quote it."""
        return str(self.args[0])


class EnvironmentFailedError(SurefootError, OSError):
    """This machine lacks something: a free port, a library, a package."""


class ChildFailedError(SurefootError):
    """One of the processes of a run failed.

    Attributes:
        exit_code: exit code for this process.
        run: the run so far, a :class:`surefoot.Run`; None if there is nothing of it.
    """

    run: Any = None

    def __init__(self, message: str, *, exit_code: int) -> None:
        """Keep the exit code beside the message."""
        super().__init__(message)
        self.exit_code = exit_code


class TuneInterrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM ended a search.

    Attributes:
        tuned: its outcome so far, a :class:`surefoot.Tuned`; None if there is none.
    """

    def __init__(self, tuned: Any) -> None:
        """Keep the outcome so far."""
        super().__init__("the search was interrupted")
        self.tuned = tuned


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C or SIGTERM ended a run.

    Attributes:
        run: the run so far, a :class:`surefoot.Run` with the outcome ``interrupted``;
            None if there is nothing of it.
    """

    def __init__(self, run: Any) -> None:
        """Keep the run so far."""
        super().__init__("the run was interrupted")
        self.run = run


class ExitCode(IntEnum):
    """Exit codes of commands; scripts may rely on them."""

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
    """Return the exit code of a run with this outcome."""
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
        Its code; None for an unforeseen error, which deserves its traceback.
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
    from surefoot.sim_robot.catalogue import ScenarioError, SimulationError
    from surefoot.stabilizer.controller import ControllerError

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
    """Return an error as it is, or as an EnvironmentFailedError if MuJoCo did not load.

    Args:
        error: ended a command. MuJoCo loads OpenGL when it is imported; for a value of
            ``MUJOCO_GL`` that does not work this fails with an error of any type.
    """
    parts = [name for name in sys.modules if name.startswith("mujoco.")]
    if not parts or "mujoco" in sys.modules or exit_code_of(error) is not None:
        return error
    return EnvironmentFailedError(
        f"MuJoCo does not load with MUJOCO_GL={os.environ.get('MUJOCO_GL', '')}: "
        f"{error}; leave it unset, or write egl or osmesa and see surefoot doctor"
    )


def complain(program: Callable[[], object]) -> None:
    """Run a driver's program; a foreseen error gives one line and its exit code."""
    try:
        program()
    except (Exception, KeyboardInterrupt) as error:  # without a code: raised again
        told = foreseen(error)
        code = exit_code_of(told)
        if code is None:
            raise
        print(f"{ERROR_PREFIX} {told}", file=sys.stderr)
        sys.exit(code)
