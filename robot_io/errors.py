"""Errors of the robot_io package."""

from __future__ import annotations

from surefoot.schemas.reasons import RequestRefusal


class RobotIoError(RuntimeError):
    """A failure between the processes, or in a robot's files."""


class RobotFileError(RobotIoError, ValueError):
    """TOML and URDF of a robot contradict each other, or one is missing."""


class EndpointError(RobotIoError, OSError):
    """A session cannot listen or dial at its locators."""


class LocatorError(EndpointError):
    """A locator is malformed: a mistake of the caller, not of the network."""


class RobotUnreachableError(RobotIoError, TimeoutError):
    """The robot did not answer in time; the message names endpoint and limit."""


class RequestRefusedError(RobotIoError):
    """A request was refused.

    Attributes:
        refusal: reason of the refusal.
        detail: the same in the words of the process that refused.
    """

    def __init__(self, message: str, *, refusal: RequestRefusal, detail: str) -> None:
        """Keep the reason beside the message."""
        super().__init__(message)
        self.refusal, self.detail = refusal, detail


class RobotMismatchError(RobotIoError, ValueError):
    """The robot on the bus is not the expected one."""


class SecondRobotError(RobotMismatchError):
    """Two robots of one namespace are on the bus."""


class CertificateError(RobotIoError, ValueError):
    """Certificates cannot be made as requested; nothing was overwritten."""


class TickFileError(RobotIoError, ValueError):
    """A file is no ticks file, or none of its ticks can be read."""
