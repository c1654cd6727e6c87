"""Clients of a served robot."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    RobotMode,
    RobotStatus,
)
from tests.robot_io.served_robot import ServedRobot
from tests.support import wait_until

WALKER = load_robot("walker")
MakeClient = Callable[..., RobotClient]


def new_client(
    endpoints: Endpoints,
    identity: str,
    stop: StopRequest | None = None,
    *,
    robot: Robot = WALKER,
) -> RobotClient:
    """Return a working client, not connected yet."""
    return RobotClient(
        robot,
        endpoints=endpoints,
        identity=identity,
        in_order=True,
        stop=stop or StopRequest(),
    )


def mode_of(served: ServedRobot) -> RobotMode:
    return served.do(lambda _, gate: gate.mode)


def refused_by(served: ServedRobot) -> dict[str, int]:
    return served.do(lambda _, gate: dict(gate.refused))


def posture_of(served: ServedRobot) -> np.ndarray:
    return served.do(lambda _, gate: gate.posture.copy())


def status_when(
    client: RobotClient, condition: Callable[[RobotStatus], bool], *, what: str
) -> RobotStatus:
    def look() -> RobotStatus | None:
        status = client.status()
        return status if status is not None and condition(status) else None

    status = wait_until(look, what=what)
    assert status is not None
    return status
