"""What everyone has in common who looks on at a robot's bus."""

from __future__ import annotations

import os
import secrets
import threading
import time
from abc import ABC, abstractmethod
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from robot_io.errors import RobotUnreachableError
from robot_io.robot import Robot
from robot_io.session import unreachable
from schemas.endpoints import Endpoints
from schemas.topics import ALIVE_OBSERVER


class Onlooker(ABC):
    """Dials a robot and knows whether it is there; has no part in its control."""

    def __init__(self, robot: Robot, *, endpoints: Endpoints) -> None:
        """Prepares; :meth:`connect` dials.

        Args:
            robot: whose presence counts.
            endpoints: where to dial.
        """
        self._namespace = robot.file.namespace
        self._endpoints = endpoints
        self._robot_is_here = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        """Does nothing yet; see :meth:`connect`."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Closes the bus."""
        self._stack.close()

    def connect(self, *, timeout_s: float) -> None:
        """Dials until the robot is alive there.

        Args:
            timeout_s: how long in all [s].

        Raises:
            EndpointError: a locator is malformed.
            RobotUnreachableError: no robot was ready in time.
        """
        end = time.monotonic() + timeout_s
        with ExitStack() as stack:
            self._open(stack, timeout_s)
            self._stack = stack.pop_all()
        if not self._robot_is_here.wait(max(0.0, end - time.monotonic())):
            what = f"no robot {self._namespace!r} is ready"
            raise RobotUnreachableError(unreachable(self._endpoints, what, timeout_s))

    @property
    def robot_is_here(self) -> bool:
        """Whether the robot's process is alive, as far as the bus knows."""
        return self._robot_is_here.is_set()

    @abstractmethod
    def _open(self, stack: ExitStack, timeout_s: float) -> None:
        """Opens the bus and declares everything, :meth:`_token` last.

        Args:
            stack: closes what is opened, now or at the end.
            timeout_s: how long to dial [s].
        """

    @staticmethod
    def _token() -> str:
        """Key of a liveliness token of its own."""
        return f"{ALIVE_OBSERVER}/{os.getpid()}-{secrets.token_hex(4)}"

    def _on_robot(self, key: str, is_there: bool) -> None:
        """Takes in that the robot has come or gone; for ``Bus.watch_presence``."""
        del key
        if is_there:
            self._robot_is_here.set()
        else:
            self._robot_is_here.clear()
