"""Exit codes of every command, and which error means which."""

from __future__ import annotations

from enum import IntEnum

from surefoot.schemas.reasons import Outcome


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

    Args:
        error: what ended a command.

    Returns:
        Its code; None for an error nobody foresaw, which deserves its traceback.
    """
    from surefoot.errors import ChildFailedError, UsageError
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
