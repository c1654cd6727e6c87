"""The robot's side of the bus without a robot: it publishes recorded messages."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import msgspec
import zenoh

from surefoot.robot_io.realtime import Pace, StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.services import RobotsSide
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import MessageError
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    RobotMode,
    RobotStatus,
    ServiceReply,
    StabilizerReply,
)
from surefoot.schemas.reasons import ModeCause, RequestRefusal
from surefoot.schemas.topics import (
    ALIVE_STABILIZER,
    ALL_CHANNELS,
    SERVICES,
    TOPICS,
    URGENT,
    Direction,
)

REFUSAL = "a replay cannot be commanded"
SETTLED_S = 0.2
"""Time without a new subscription after which an audience is complete [s]."""
POLL_S = 0.01


class ReplayServer(RobotsSide):
    """Publishes recorded messages in the robot's place, and refuses every request.

    A context manager, used by one thread. Other processes take it for the robot: it has
    the same keys and a liveliness token with the robot's description and an instance of
    its own. While a recorded status names a commander, that one's token is there, too.
    """

    def __init__(
        self, robot: Robot, *, endpoints: Endpoints, stop: StopRequest
    ) -> None:
        """Prepare; entering the context opens the bus."""
        super().__init__(robot, endpoints=endpoints, stop=stop)
        self._status = _nothing_said(robot)
        self._commander = ""
        self._stabilizer: zenoh.LivelinessToken | None = None

    def __exit__(self, *why: object) -> None:
        """Say farewell where the record does not, and close the bus."""
        if not self._status.is_farewell:
            status = msgspec.structs.replace(
                self._status,
                mode=RobotMode.OFF,
                cause=ModeCause.STOPPED,
                detail="the replay is over",
                commander="",
            )
            self._say_farewell(encode(status))
        super().__exit__(*why)

    def wait_for_audience(self) -> bool:
        """Wait until somebody has subscribed and no more subscriptions come.

        Returns:
            Whether somebody has; False after a stop request.
        """
        seen: set[str] = set()
        since_s = time.monotonic()
        while not self._stop.is_set:
            now = {
                name
                for name, publisher in self._publishers.items()
                # Its type stubs lack this property.
                if publisher.matching_status.matching  # type: ignore[attr-defined]
            }
            if now != seen:
                seen, since_s = now, time.monotonic()
            elif seen and time.monotonic() - since_s >= SETTLED_S:
                return True
            time.sleep(POLL_S)  # only time shows that nobody else comes
        return False

    def publish(self, channel: str, data: bytes) -> None:
        """Publish a recorded message."""
        if channel == "status":
            self._note_status(data)
            if self._status.is_farewell:
                self._say_farewell(data)
                return
        self._publishers[channel].put(data)

    def _declare(self) -> None:
        keys = self._robot.keys
        self._publishers = {
            name: self._bus.publisher(keys[name], urgent=name in URGENT)
            for name in ALL_CHANNELS
        }
        for entry in TOPICS:
            if entry.direction in SERVICES:
                answer = partial(self._refuse, entry.direction)
                self._bus.queryable(keys[entry.name], answer)

    def _refuse(self, direction: Direction, query: zenoh.Query) -> None:
        status = self._status
        told: dict[str, Any] = {
            "schema": SCHEMA_VERSION,
            "accepted": False,
            "refusal": RequestRefusal.RECORDED,
            "detail": REFUSAL,
        }
        reply: ServiceReply | StabilizerReply
        if direction is Direction.SERVICE:
            reply = ServiceReply(
                **told,
                mode=status.mode,
                commander=status.commander,
                q_command=status.q_command,
                instance=self.identity.instance,
                description=self.identity.description,
                pace=Pace.REALTIME,
            )
        else:
            reply = StabilizerReply(**told, tick=status.tick, settings={})
        with query:
            query.reply(query.key_expr, encode(reply))

    def _note_status(self, data: bytes) -> None:
        """Keep the status for refusals; show the stabilizer while it commands."""
        try:
            status = decode(data, RobotStatus, joint_count=self._robot.n_a)
        except MessageError:
            return
        self._status = status
        if status.commander == self._commander:
            return
        if self._stabilizer is not None:
            self._stabilizer.undeclare()  # type: ignore[no-untyped-call]
            self._stabilizer = None
        self._commander = status.commander
        if status.commander:
            self._stabilizer = self._bus.session.liveliness().declare_token(
                f"{ALIVE_STABILIZER}/{status.commander}"
            )


def _nothing_said(robot: Robot) -> RobotStatus:
    """Return the status of a robot of which no status has been played yet."""
    return RobotStatus(
        schema=SCHEMA_VERSION,
        tick=0,
        stamp_ns=0,
        mode=RobotMode.HOLD,
        cause=ModeCause.STARTED,
        detail="",
        notice="",
        commander="",
        command_age_s=-1.0,
        q_command=robot.nominal.tolist(),
        refused={},
        clipped={},
        deadline_misses=0,
    )
