"""A planner's client: hears how the walk goes, and says what to walk next."""

from __future__ import annotations

from contextlib import ExitStack

import zenoh

from surefoot.robot_io.bus.bus import dialed_bus
from surefoot.robot_io.bus.inbox import Latest
from surefoot.robot_io.client_side.read_only_client import ReadOnlyClient
from surefoot.robot_io.robot import Robot
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.topics import ALIVE_STABILIZER
from surefoot.schemas.walk_plan import WalkPlan, WalkStatus


class PlannerClient(ReadOnlyClient):
    """Sends plans to whatever stabilizer commands the robot.

    A context manager, used by one thread. It commands nothing: the stabilizer decides
    what of a plan it takes, and tells in the walk's status.
    """

    def __init__(self, robot: Robot, *, endpoints: Endpoints) -> None:
        """Prepare; :meth:`connect` dials.

        Args:
            robot: whose keys are used.
            endpoints: where to dial.
        """
        super().__init__(robot, endpoints=endpoints)
        self._keys = robot.keys
        self._status: Latest[WalkStatus] | None = None
        self._plan: zenoh.Publisher | None = None
        self._stabilizers: set[str] = set()

    @property
    def has_stabilizer(self) -> bool:
        """Whether there is anybody to take plans."""
        return bool(self._stabilizers)

    def status(self) -> WalkStatus | None:
        """Return the newest word of the walk; None before the first."""
        return None if self._status is None else self._status.poll()

    def send(self, plan: WalkPlan) -> None:
        """Send a plan. One may be lost: what counts is said again."""
        if self._plan is not None:
            self._plan.put(encode(plan))

    def _open(self, stack: ExitStack, timeout_s: float) -> None:
        bus = stack.enter_context(
            dialed_bus(self._endpoints, namespace=self._namespace, timeout_s=timeout_s)
        )
        status = bus.channel(self._keys["walk_status"], depth=1)
        self._status = Latest(status, WalkStatus)
        self._plan = bus.publisher(self._keys["walk"], urgent=False)
        bus.announce(self._token())
        self._follow_robot(bus, self._keys["status"])
        bus.watch_presence(f"{ALIVE_STABILIZER}/*", self._on_stabilizer)

    def _on_stabilizer(self, key: str, is_there: bool) -> None:
        if is_there:
            self._stabilizers.add(key)
        else:
            self._stabilizers.discard(key)
