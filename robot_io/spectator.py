"""Looks on: reads what robot and stabilizer say of themselves, commands nothing."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple, Self

import msgspec

from robot_io.bus import Bus
from robot_io.latest import Latest, T
from robot_io.robot import Robot
from robot_io.service_caller import R, ServiceCaller
from robot_io.session import Role
from schemas.endpoints import Endpoints
from schemas.messages import (
    SCHEMA_VERSION,
    ControlRequest,
    EstopRequest,
    ImuState,
    JointState,
    PushRequest,
    RobotStatus,
    ServiceReply,
    SettingsRequest,
    StabilizerReply,
    StabilizerStatus,
    Truth,
)
from schemas.topics import ALIVE_ROBOT, ALIVE_STABILIZER

REQUEST_TIMEOUT_S = 2.0
DIAL_S = 1.0


class Sight(NamedTuple):
    """The newest message of each channel looked at; None where none has come."""

    joints: JointState | None
    imu: ImuState | None
    status: RobotStatus | None
    stabilizer: StabilizerStatus | None
    truth: Truth | None


class Spectator:
    """A client that only subscribes; what it asks for, anyone may ask.

    Each channel keeps one message, in Zenoh: however fast the robot talks and however
    slowly one looks, the sender is never held up. A context manager.
    """

    def __init__(self, robot: Robot, *, endpoints: Endpoints, identity: str) -> None:
        """Prepares; entering the context dials.

        Args:
            robot: names keys and joints.
            endpoints: where to dial.
            identity: named in the robot's log when something is asked.
        """
        self._robot, self._identity = robot, identity
        self._bus = Bus(
            endpoints,
            Role.CLIENT,
            namespace=robot.file.namespace,
            timeout_s=DIAL_S,
        )
        self._stack = ExitStack()
        self._robot_is_here = threading.Event()
        self._stabilizers: set[str] = set()

    def __enter__(self) -> Self:
        """Dials once; whoever wants to wait tries again.

        Raises:
            EndpointError: a locator is malformed.
            RobotUnreachableError: nobody answers.
        """
        with ExitStack() as stack:
            stack.enter_context(self._bus)
            self._declare()
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Closes the bus."""
        self._stack.close()

    @property
    def robot_is_here(self) -> bool:
        """Whether the robot's process is alive, as far as the bus knows."""
        return self._robot_is_here.is_set()

    @property
    def stabilizer_is_here(self) -> bool:
        """Whether any stabilizer's process is alive, as far as the bus knows."""
        return bool(self._stabilizers)

    def look(self) -> Sight:
        """The newest of everything, without waiting."""
        return Sight(
            self._joints.poll(),
            self._imu.poll(),
            self._status.poll(),
            self._stabilizer.poll(),
            self._truth.poll(),
        )

    def stop_robot(self) -> ServiceReply:
        """E-stop; open to everyone.

        Raises:
            RobotUnreachableError: no answer.
        """
        request = EstopRequest(schema=SCHEMA_VERSION, source=self._identity)
        return self._ask("estop", request, ServiceReply)

    def push(
        self, body: str, force_n: list[float], *, duration_s: float
    ) -> ServiceReply:
        """Pushes a simulated robot.

        Args:
            body: link of the URDF.
            force_n: world axes [N].
            duration_s: for how long [s].

        Raises:
            RequestRefusedError: no such body, or too strong.
            RobotUnreachableError: no answer: this robot is none to be pushed.
        """
        request = PushRequest(
            schema=SCHEMA_VERSION,
            source=self._identity,
            body=body,
            force_n=force_n,
            duration_s=duration_s,
        )
        return self._ask("push", request, ServiceReply)

    def control(self, action: str) -> StabilizerReply:
        """Asks the stabilizer to ``hold`` or ``resume``.

        Raises:
            RequestRefusedError: it says no, and why.
            RobotUnreachableError: no answer.
        """
        request = ControlRequest(
            schema=SCHEMA_VERSION, source=self._identity, action=action
        )
        return self._ask("control", request, StabilizerReply)

    def change_settings(self, changes: dict[str, list[float]]) -> StabilizerReply:
        """Asks the stabilizer for other gains; without any, for the present ones.

        Raises:
            RequestRefusedError: a value cannot be used, or none can be changed.
            RobotUnreachableError: no answer.
        """
        request = SettingsRequest(
            schema=SCHEMA_VERSION, source=self._identity, changes=changes
        )
        return self._ask("settings", request, StabilizerReply)

    def _ask(self, name: str, request: msgspec.Struct, kind: type[R]) -> R:
        return self._services.ask_for(self._robot.keys[name], request, kind)

    def _declare(self) -> None:
        n_a = self._robot.n_a
        self._joints = self._latest("joints", JointState, n_a)
        self._imu = self._latest("imu", ImuState)
        self._status = self._latest("status", RobotStatus, n_a)
        self._stabilizer = self._latest("stabilizer", StabilizerStatus)
        self._truth = self._latest("truth", Truth)
        self._services = ServiceCaller(
            self._bus.session,
            joint_count=n_a,
            timeout_s=REQUEST_TIMEOUT_S,
            robot_is_here=self._robot_is_here.is_set,
        )
        self._bus.watch_presence(ALIVE_ROBOT, self._on_robot)
        self._bus.watch_presence(f"{ALIVE_STABILIZER}/*", self._on_stabilizer)

    def _latest(
        self, name: str, kind: type[T], joint_count: int | None = None
    ) -> Latest[T]:
        channel = self._bus.channel(self._robot.keys[name], depth=1)
        return Latest(channel, kind, joint_count=joint_count)

    def _on_robot(self, key: str, is_there: bool) -> None:
        del key
        if is_there:
            self._robot_is_here.set()
        else:
            self._robot_is_here.clear()

    def _on_stabilizer(self, key: str, is_there: bool) -> None:
        if is_there:
            self._stabilizers.add(key)
        else:
            self._stabilizers.discard(key)
