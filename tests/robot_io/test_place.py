"""Of two robots that start at once, at most one stays."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from surefoot.robot_io.errors import SecondRobotError
from surefoot.robot_io.identity import RobotIdentity, describe
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.robot_io.robot_side.services import take_place
from surefoot.schemas.endpoints import Endpoints
from tests.robot_io.meeting_places import meeting_place
from tests.robot_io.strange_robots import WALKER
from tests.support import PATIENCE_S

LESS, OURS, GREATER = (
    RobotIdentity(instance, describe(WALKER))
    for instance in ("00000000", "77777777", "ffffffff")
)
STARTS = 4


class ScriptedBus:
    """A bus on which others come and go when we declare our token."""

    def __init__(self, *events: tuple[RobotIdentity, bool], after_s: float = 0.0):
        self.announced: list[str] = []
        self._events, self._after_s = events, after_s

    def watch_presence(self, key: str, changed: Callable[[str, bool], None]) -> None:
        assert key == "alive/robot/**"
        self._changed = changed

    def settle(self) -> None:
        pass

    def announce(self, key: str) -> None:
        self.announced.append(key)
        (come, *others) = self._events
        self._tell(come)
        if others:
            threading.Timer(self._after_s, self._tell, others).start()

    def _tell(self, event: tuple[RobotIdentity, bool]) -> None:
        self._changed(event[0].token, event[1])


def start_on(bus: ScriptedBus, stop: StopRequest | None = None) -> None:
    take_place(
        bus,  # type: ignore[arg-type]
        WALKER,
        OURS,
        lease_ms=500,
        stop=stop or StopRequest(),
    )


def test_its_own_token_is_no_other_robot() -> None:
    bus = ScriptedBus((OURS, True))
    start_on(bus)
    assert bus.announced == [OURS.token]


def test_the_greater_instance_gives_way_at_once() -> None:
    words = f"instance {LESS.instance}; this one would be {OURS.instance}"
    with pytest.raises(SecondRobotError, match=words):
        start_on(ScriptedBus((LESS, True), (LESS, False), after_s=0.1))


def test_the_lesser_instance_stays_once_the_greater_has_gone() -> None:
    bus = ScriptedBus((GREATER, True), (GREATER, False), after_s=0.1)
    start_on(bus)
    assert bus.announced == [OURS.token]


def test_nor_does_the_lesser_stay_beside_a_greater_that_does_not_go() -> None:
    with pytest.raises(SecondRobotError, match="ffffffff"):
        start_on(ScriptedBus((GREATER, True)))


def test_who_is_asked_to_stop_meanwhile_takes_no_place() -> None:
    stop = StopRequest()
    stop.set("a test")
    bus = ScriptedBus((GREATER, True))
    start_on(bus, stop)
    assert bus.announced == []


def test_of_robots_started_at_once_one_stays() -> None:
    with meeting_place(routed=True) as endpoints:
        for _ in range(STARTS):
            assert started_at_once(endpoints, 3) == 1


def started_at_once(endpoints: Endpoints, count: int) -> int:
    """Return how many of some robots keep their place."""
    together, over = threading.Barrier(count), threading.Barrier(count)
    in_place: list[str] = []
    wrong: list[Exception] = []

    def start() -> None:
        gate = CommandGate(WALKER, WALKER.nominal)
        server = RobotServer(WALKER, gate, endpoints=endpoints, stop=StopRequest())
        together.wait(PATIENCE_S)
        try:
            with server:
                in_place.append(server.identity.instance)
                over.wait(PATIENCE_S)
        except SecondRobotError:
            over.wait(PATIENCE_S)
        except Exception as error:
            wrong.append(error)

    threads = [threading.Thread(target=start) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(2 * PATIENCE_S)
    assert not wrong
    return len(in_place)
