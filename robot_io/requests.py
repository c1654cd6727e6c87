"""What somebody beside the control loop may ask of robot and stabilizer."""

from __future__ import annotations

import msgspec

from robot_io.robot import Robot
from robot_io.service_caller import R, ServiceCaller
from schemas.messages import (
    SCHEMA_VERSION,
    ControlRequest,
    EstopRequest,
    PushRequest,
    ServiceReply,
    SettingsRequest,
    StabilizerReply,
)


class Requests:
    """Asks without holding the lease; with TLS, the certificate says who may what.

    The e-stop is open to everyone; the rest needs an operator's certificate.
    """

    def __init__(self, caller: ServiceCaller, robot: Robot, *, source: str) -> None:
        """Asks through a caller.

        Args:
            caller: of an open session.
            robot: names the keys.
            source: who asks, for the log of who is asked.
        """
        self._caller, self._robot, self._source = caller, robot, source

    def stop_robot(self) -> ServiceReply:
        """E-stop; open to everyone.

        Raises:
            RobotUnreachableError: no answer.
        """
        request = EstopRequest(schema=SCHEMA_VERSION, source=self._source)
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
            source=self._source,
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
            schema=SCHEMA_VERSION, source=self._source, action=action
        )
        return self._ask("control", request, StabilizerReply)

    def change_settings(self, changes: dict[str, list[float]]) -> StabilizerReply:
        """Asks the stabilizer for other gains; without any, for the present ones.

        Raises:
            RequestRefusedError: a value cannot be used, or none can be changed.
            RobotUnreachableError: no answer.
        """
        request = SettingsRequest(
            schema=SCHEMA_VERSION, source=self._source, changes=changes
        )
        return self._ask("settings", request, StabilizerReply)

    def _ask(self, name: str, request: msgspec.Struct, kind: type[R]) -> R:
        return self._caller.ask_for(self._robot.keys[name], request, kind)
