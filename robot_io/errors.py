"""Errors of the robot_io package."""

from __future__ import annotations

from collections.abc import Iterable

from surefoot.schemas.reasons import RequestRefusal


class RobotIoError(RuntimeError):
    """Something between the processes, or in a robot's files, went wrong."""


class RobotFileError(RobotIoError, ValueError):
    """TOML and URDF of a robot do not fit together, or one is missing."""


class EndpointError(RobotIoError, OSError):
    """A session cannot listen or dial where it should; ``locators`` says where."""

    def __init__(self, message: str, *, locators: list[str]) -> None:
        """Keep the locators beside the message."""
        super().__init__(message)
        self.locators = locators


class LocatorError(EndpointError):
    """A locator is not written as one: a mistake of the caller, not of the network."""


class RobotUnreachableError(RobotIoError, TimeoutError):
    """The robot did not answer in time; the message names endpoint and limit."""


class RequestRefusedError(RobotIoError):
    """A request was refused.

    Attributes:
        refusal: why.
        detail: the same in the words of who refused.
    """

    def __init__(self, message: str, *, refusal: RequestRefusal, detail: str) -> None:
        """Keep why beside the message."""
        super().__init__(message)
        self.refusal, self.detail = refusal, detail


class RobotMismatchError(RobotIoError, ValueError):
    """The robot on the bus is not the one that is meant.

    Attributes:
        namespace: of both.
        differing: parts of the description in which they differ.
    """

    def __init__(
        self, message: str, *, namespace: str, differing: Iterable[str] = ()
    ) -> None:
        """Keep what differs beside the message."""
        super().__init__(message)
        self.namespace = namespace
        self.differing = tuple(differing)


class SecondRobotError(RobotMismatchError):
    """There are two robots of one namespace on the bus."""

    def __init__(
        self, message: str, *, namespace: str, instances: Iterable[str]
    ) -> None:
        """Keep the instances beside the message."""
        super().__init__(message, namespace=namespace)
        self.instances = tuple(instances)


class CertificateError(RobotIoError, ValueError):
    """Certificates cannot be made as asked; nothing was overwritten."""


class TickFileError(RobotIoError, ValueError):
    """A file is no ticks file, or nothing of it can be read."""
