"""The right to ask the stabilizer for something, over TLS on loopback."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

import msgspec
import pytest
import zenoh

from surefoot.robot_io.bus.session import Role, open_session
from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    ControlRequest,
    LeaseRequest,
    SettingsRequest,
    StabilizerReply,
)
from tests.robot_io.client_at_work import new_client
from tests.robot_io.secured import Authority
from tests.robot_io.served_robot import serving
from tests.support import PATIENCE_S, wait_until

TRIES = 10
FEW = 2
"""Attempts at a request that must not be answered; other tests show it could be."""
ATTEMPT_S = 0.4
NOTHING = b"nothing"
TICK = 42
SETTINGS = SettingsRequest(schema=SCHEMA_VERSION, source="eve", changes={})
CONTROL = ControlRequest(schema=SCHEMA_VERSION, source="eve", action="hold")
LEASE = LeaseRequest(
    schema=SCHEMA_VERSION, action="take", commander="eve", robot="", description=""
)


class Meeting:
    """A stabilizer in command of a robot, and a client of any identity."""

    def __init__(
        self, robot: Robot, authority: Authority, ann: RobotClient, *, routed: bool
    ) -> None:
        self.robot, self._authority, self._ann = robot, authority, ann
        self._routed = routed
        self.asked = 0

    def session(self, identity: str) -> AbstractContextManager[zenoh.Session]:
        endpoints = as_who(self._authority, identity, routed=self._routed)
        return open_session(endpoints, Role.CLIENT, namespace="walker")

    def answers(
        self, session: zenoh.Session, name: str, data: bytes, *, attempts: int = TRIES
    ) -> bytes | None:
        """Return the answer to a request, which is repeated until it is answered."""
        for _ in range(attempts):
            replies = session.get(
                self.robot.keys[name], payload=data, timeout=ATTEMPT_S
            )
            come = wait_until(
                lambda r=replies: self._serve(r), what="an end of answers"
            )
            if come != NOTHING:
                return come
        return None

    def _serve(self, replies: zenoh.Handler) -> bytes | None:
        """Serve as the stabilizer, and return the client's answer, if any."""
        while (asked := self._ann.next_request()) is not None:
            self.asked += 1
            asked.reply(tick=TICK, settings={})
        try:
            reply = replies.try_recv()
        except zenoh.ZError:
            return NOTHING  # there will be none any more
        return reply.ok.payload.to_bytes() if reply and reply.ok else None


def as_who(authority: Authority, identity: str, *, routed: bool) -> Endpoints:
    endpoints = authority.endpoints(identity)
    router = endpoints.listen if routed else []
    return msgspec.structs.replace(endpoints, router=router)


@pytest.fixture(scope="module", params=[False, True], ids=["direct", "routed"])
def meeting(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Meeting]:
    robot, routed = load_robot("walker-real"), request.param
    folder: Path = tmp_path_factory.mktemp("authority") / "certs"
    authority = Authority(folder)
    with ExitStack() as stack:
        if routed:
            endpoints = as_who(authority, "router", routed=True)
            stack.enter_context(
                open_session(
                    endpoints, Role.ROUTER, namespace="walker", keys=robot.keys
                )
            )
        stack.enter_context(serving(robot, as_who(authority, "robot", routed=routed)))
        theirs = as_who(authority, "stabilizer", routed=routed)
        ann = stack.enter_context(new_client(theirs, "ann", robot=robot))
        assert ann.connect(timeout_s=PATIENCE_S)
        ann.take_lease()
        yield Meeting(robot, authority, ann, routed=routed)


@pytest.mark.parametrize("request_", [SETTINGS, CONTROL], ids=["settings", "control"])
def test_an_operator_is_answered_by_the_stabilizer(
    meeting: Meeting, request_: msgspec.Struct
) -> None:
    name = "settings" if request_ is SETTINGS else "control"
    with meeting.session("operator") as session:
        data = meeting.answers(session, name, encode(request_))
        assert data is not None
        assert decode(data, StabilizerReply).tick == TICK


def test_an_operator_does_not_command(meeting: Meeting) -> None:
    with meeting.session("operator") as session:
        assert meeting.answers(session, "settings", encode(SETTINGS)) is not None
        assert meeting.answers(session, "lease", encode(LEASE), attempts=FEW) is None
        assert meeting.answers(session, "mode", encode(LEASE), attempts=FEW) is None


@pytest.mark.parametrize("identity", ["observer", "planner"])
def test_others_do_not_reach_the_stabilizer(meeting: Meeting, identity: str) -> None:
    before = meeting.asked
    with meeting.session(identity) as session:
        assert (
            meeting.answers(session, "settings", encode(SETTINGS), attempts=FEW) is None
        )
        assert (
            meeting.answers(session, "control", encode(CONTROL), attempts=FEW) is None
        )
    assert meeting.asked == before


def test_an_operator_cannot_answer_in_the_place_of_the_stabilizer(
    meeting: Meeting,
) -> None:
    key = meeting.robot.keys["settings"]
    forged: list[zenoh.Query] = []
    with (
        meeting.session("operator") as impostor,
        meeting.session("operator") as session,
    ):
        impostor.declare_queryable(key, forged.append)
        for _ in range(FEW):
            assert meeting.answers(session, "settings", encode(SETTINGS)) is not None
    assert forged == []
