"""A router checks identities that the robot behind it cannot see."""

from __future__ import annotations

from pathlib import Path

import msgspec

from surefoot.robot_io.bus.session import Role, open_session
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from tests.robot_io.client_at_work import new_client
from tests.robot_io.secured import Authority
from tests.robot_io.served_robot import serving
from tests.support import PATIENCE_S, wait_until

ATTEMPTS = 5


def test_a_router_lets_each_identity_do_its_own(tmp_path: Path) -> None:
    robot = load_robot("walker-real")
    authority = Authority(tmp_path / "certs")

    def as_who(identity: str) -> Endpoints:
        endpoints = authority.endpoints(identity)
        return msgspec.structs.replace(endpoints, router=endpoints.listen)

    with (
        open_session(
            as_who("router"), Role.ROUTER, namespace="walker", keys=robot.keys
        ),
        serving(robot, as_who("robot")) as served,
        new_client(as_who("stabilizer"), "ann", robot=robot) as ann,
        open_session(as_who("observer"), Role.CLIENT, namespace="walker") as observer,
    ):
        assert ann.connect(timeout_s=PATIENCE_S)
        lease = encode(served.lease_request("eve"))

        def answers(key: str, data: bytes) -> bool:
            return any(r.ok for r in observer.get(key, payload=data, timeout=0.3))

        for _ in range(ATTEMPTS):
            assert not answers(robot.keys["lease"], lease)
        assert served.do(lambda server, gate: gate.modes.lease.holder) == ""
        ann.take_lease()
        ann.enable()
        assert served.do(lambda server, gate: gate.mode) is RobotMode.ACTIVE
        wait_until(lambda: answers(robot.keys["estop"], b"stop"), what="the e-stop")
        assert served.do(lambda server, gate: gate.mode) is RobotMode.FAULT
        assert served.do(lambda server, gate: gate.modes.lease.holder) == "ann"
