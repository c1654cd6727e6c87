"""A router: where robot, stabilizer and others meet when they cannot dial each other.

It is Zenoh's own, run from its library; ``zenohd`` with the configurations in deploy/
does the same.
"""

from __future__ import annotations

import threading

from surefoot.robot_io.bus.session import Role, open_session
from surefoot.robot_io.bus.stop_request import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.schemas.endpoints import Endpoints

POLL_S = 0.1


def run_router(robot: Robot, *, endpoints: Endpoints, stop: StopRequest) -> None:
    """Route until asked to stop.

    Args:
        robot: its keys and namespace are what access control is about.
        endpoints: where to listen.
        stop: ends it, besides signals.

    Raises:
        EndpointError: cannot listen there.
    """
    asked = threading.Event()
    stop.waking(asked.set)
    with (
        stop.on_signals(),
        open_session(
            endpoints,
            Role.ROUTER,
            namespace=robot.file.namespace,
            keys=robot.keys,
        ),
    ):
        while not asked.wait(POLL_S):  # a signal's handler runs between two waits
            pass
