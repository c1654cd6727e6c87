"""A robot's place on the bus: one robot for each namespace."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.stop_request import StopRequest
from surefoot.robot_io.errors import SecondRobotError
from surefoot.robot_io.identity import RobotIdentity, parse_token
from surefoot.robot_io.robot import Robot
from surefoot.schemas.topics import ALIVE_ROBOT

_LOG = logging.getLogger(__name__)

PATIENCE_S = 3.0
"""The token of a robot that died stands until the bus has given its host up."""
LEASES = 2
"""But at least for so many of the bus's own limits of silence."""
YIELD_S = 2.0
"""Who must give way to us has done so by then."""
POLL_S = 0.02
Instance = str
Instances = list[Instance]


def take_place(
    bus: Bus,
    robot: Robot,
    identity: RobotIdentity,
    *,
    lease_ms: int,
    stop: StopRequest,
) -> None:
    """Declare the robot's liveliness token, unless another robot has one.

    It looks before, with patience for what a dead robot left behind, and after: of two
    robots that start at once at least one sees the other, and the one with the greater
    instance gives way.

    Args:
        bus: open, everything else declared.
        robot: whose namespace it is.
        identity: of this process.
        lease_ms: after which silence the bus gives somebody up [ms].
        stop: ends the wait; then nothing is declared.

    Raises:
        SecondRobotError: there is another robot, and it stays.
    """
    there: set[str] = set()

    def on_token(key: str, is_there: bool) -> None:
        (there.add if is_there else there.discard)(parse_token(key).instance)

    def others() -> Instances:
        return sorted(there.copy() - {identity.instance})

    bus.watch_presence(f"{ALIVE_ROBOT}/**", on_token)
    bus.settle()
    if others():
        _LOG.warning(
            "a robot %r is on the bus (instance %s); waiting for it to go",
            *(robot.file.namespace, ", ".join(others())),
        )
    patience_s = max(PATIENCE_S, LEASES * lease_ms / 1e3)
    _refuse_beside(_who_stays(others, patience_s, stop), robot, identity)
    if stop.is_set:
        return
    bus.announce(identity.token)
    bus.settle()
    # Whoever sees a lesser one goes at once, also while it waits for greater ones: the
    # least could lose patience in the same moment as the others, and none would stay.
    came = _who_stays(others, YIELD_S, stop, before=identity.instance)
    _refuse_beside(came, robot, identity)


def _who_stays(
    others: Callable[[], Instances],
    patience_s: float,
    stop: StopRequest,
    *,
    before: Instance = "",
) -> Instances:
    """Who is there still when patience is at its end, or a lesser instance is."""
    pause = threading.Event()  # never set: somebody else's leaving wakes nobody
    end_s = time.monotonic() + patience_s
    while there := others():
        is_less = any(instance < before for instance in there)
        if is_less or stop.is_set or time.monotonic() >= end_s:
            break
        pause.wait(POLL_S)
    return there


def _refuse_beside(others: Instances, robot: Robot, identity: RobotIdentity) -> None:
    if not others:
        return
    namespace, names = robot.file.namespace, " and ".join(others)
    raise SecondRobotError(
        f"a robot {namespace!r} is on this bus already (instance {names or 'unknown'}; "
        f"this one would be {identity.instance}), and both would obey the same "
        "commands; stop that one, or give this one a `namespace` of its own in its "
        "robot file",
        namespace=namespace,
        instances=[*others, identity.instance],
    )
