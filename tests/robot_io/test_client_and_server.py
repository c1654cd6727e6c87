"""Client and server over Zenoh on this host."""

from __future__ import annotations

import threading
import time

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.client_side.observer import VIEWER_CHANNELS, Observer
from surefoot.robot_io.client_side.requests import ServiceCaller
from surefoot.robot_io.errors import RequestRefusedError
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import CommandResult
from surefoot.robot_io.robot_side.server import NoAnswer, RobotServer
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    GroundBlock,
    ModeRequest,
    Reference,
    RobotMode,
    Truth,
)
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.topics import ALIVE_STABILIZER
from surefoot.stabilizer.walking.feet import WalkState
from tests.robot_io.client_at_work import (
    WALKER,
    MakeClient,
    mode_of,
    new_client,
    posture_of,
    refused_by,
    status_when,
)
from tests.robot_io.sensor_messages import snapshot_at
from tests.robot_io.served_robot import ServedRobot
from tests.schemas.simplest_message import simplest_message
from tests.support import PATIENCE_S, wait_until

# Command --------------------------------------------------------------------------


def test_enabling_tells_the_held_posture(
    served: ServedRobot, make_client: MakeClient
) -> None:
    client = make_client("ann")
    client.take_lease()
    assert np.array_equal(client.enable(), WALKER.nominal)
    assert mode_of(served) is RobotMode.ACTIVE


def test_a_command_reaches_the_gate_as_it_was_sent(
    served: ServedRobot, commander: RobotClient
) -> None:
    tick = served.publish_tick()
    reading = commander.wait_snapshot(timeout_s=PATIENCE_S)
    assert reading is not None
    assert np.array_equal(reading.snapshot.q, snapshot_at(tick).q)
    q = WALKER.nominal + 1e-3 * np.sin(np.arange(WALKER.n_a))
    commander.send(q, tick=tick)
    wait_until(lambda: np.array_equal(posture_of(served), q), what="the command")
    assert refused_by(served) == {}


def test_the_answer_to_a_tick_ends_the_wait_for_it(
    endpoints: Endpoints, make_client: MakeClient
) -> None:
    gate = CommandGate(WALKER, WALKER.nominal)
    with (
        RobotServer(WALKER, gate, endpoints=endpoints, stop=StopRequest()) as server,
        ThreadedClient(make_client) as client,
    ):
        assert server.wait_until_active(timeout_s=PATIENCE_S)
        for tick in range(100):
            gate.begin_tick(now_s=tick * 1e-3)
            server.publish_sensors(snapshot_at(tick), stamp_ns=0)
            answer = wait_for_answer(server, tick)
            assert isinstance(answer, CommandResult)
            assert answer.answers == tick
            assert answer.accepted
        gate.modes.finish(ModeCause.RUN_OVER, "over")
        server.see_off("", now_s=0.1)
    assert client.answered == 100


def wait_for_answer(server: RobotServer, tick: int) -> CommandResult | NoAnswer:
    """Wait as the robot's loop does; requests that interrupt the wait are served."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        answer = server.answer(tick, now_s=tick * 1e-3, deadline=deadline)
        if answer is not NoAnswer.YET:
            return answer
        server.serve_requests(now_s=tick * 1e-3)
    return NoAnswer.YET


class ThreadedClient:
    """A client that answers every tick by the nominal posture until the mode is OFF."""

    def __init__(self, make_client: MakeClient) -> None:
        self.answered = 0
        self._thread = threading.Thread(target=self._run, args=(make_client,))

    def __enter__(self) -> ThreadedClient:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(PATIENCE_S)

    def _run(self, make_client: MakeClient) -> None:
        client = make_client("ann")
        client.take_lease()
        client.enable()
        while True:
            reading = client.wait_snapshot(timeout_s=0.05)
            if reading is not None:
                client.send(WALKER.nominal, tick=reading.snapshot.tick)
                self.answered += 1
            status = client.status()
            if status is not None and status.mode is RobotMode.OFF:
                return


def test_a_second_commander_is_refused_by_name(
    served: ServedRobot, commander: RobotClient, make_client: MakeClient
) -> None:
    second = make_client("bob")
    with pytest.raises(RequestRefusedError, match="ann holds the lease") as caught:
        second.take_lease()
    assert caught.value.detail == "ann holds the lease, bob does not"
    tick = served.publish_tick()
    second.send(WALKER.nominal + 0.001, tick=tick)
    wait_until(lambda: refused_by(served) == {"lease": 1}, what="the refusal")
    assert np.array_equal(posture_of(served), WALKER.nominal)


def test_leaving_gives_the_lease_back(
    served: ServedRobot, endpoints: Endpoints, make_client: MakeClient
) -> None:
    with new_client(endpoints, "ann") as first:
        first.connect(timeout_s=PATIENCE_S)
        first.take_lease()
        first.enable()
    assert mode_of(served) is RobotMode.HOLD
    make_client("bob").take_lease()


def test_a_commander_that_leaves_without_a_word_loses_the_lease(
    served: ServedRobot, endpoints: Endpoints, make_client: MakeClient
) -> None:
    with Bus(endpoints, Role.CLIENT, namespace="walker") as bus:
        bus.announce(f"{ALIVE_STABILIZER}/ann")
        services = ServiceCaller(
            bus.session,
            joint_count=WALKER.n_a,
            timeout_s=PATIENCE_S,
            robot_is_here=lambda: True,
            check=lambda reply: None,
        )
        take = served.lease_request("ann")
        enable = ModeRequest(schema=SCHEMA_VERSION, action="enable", commander="ann")
        services.ask("srv/lease", take)
        assert services.ask("srv/mode", enable).mode is RobotMode.ACTIVE
    wait_until(lambda: mode_of(served) is RobotMode.HOLD, what="HOLD")
    assert served.do(lambda _, gate: gate.modes.detail) == "ann is gone"
    make_client("bob").take_lease()


def test_a_walk_is_forgotten_with_the_stabilizer_that_told_of_it(
    served: ServedRobot, endpoints: Endpoints, make_client: MakeClient
) -> None:
    with Observer(
        WALKER, endpoints=endpoints, channels=VIEWER_CHANNELS, identity="eve"
    ) as eve:
        eve.connect(timeout_s=PATIENCE_S)
        with new_client(endpoints, "ann") as first:
            first.connect(timeout_s=PATIENCE_S)
            wait_until(lambda: eve.stabilizers == ("ann",), what="Ann")
            eve.latest_messages()
            first.publish_walk(WalkState().message(tick=1, stamp_ns=1))
            wait_until(lambda: eve.latest_messages().walk_status, what="her walk")
        wait_until(lambda: eve.stabilizers == (), what="Ann to be gone")
        assert eve.latest_messages().walk_status is not None
        second = make_client("bob")
        wait_until(lambda: eve.stabilizers == ("bob",), what="Bob")
        assert eve.latest_messages().walk_status is None
        second.publish_walk(WalkState().message(tick=2, stamp_ns=2))
        wait_until(lambda: eve.latest_messages().walk_status, what="his walk")


# Modes ----------------------------------------------------------------------------


def test_an_e_stop_comes_from_anyone_and_latches(
    endpoints: Endpoints, served: ServedRobot, commander: RobotClient
) -> None:
    with Observer(WALKER, endpoints=endpoints, identity="eve") as bystander:
        bystander.connect(timeout_s=PATIENCE_S)
        assert bystander.requests.stop_robot().mode is RobotMode.FAULT
    with pytest.raises(RequestRefusedError, match="e-stop by eve"):
        commander.enable()
    commander.request_mode("reset")
    commander.enable()
    assert mode_of(served) is RobotMode.ACTIVE


def test_an_unreadable_e_stop_stops_too(
    served: ServedRobot, commander: RobotClient, endpoints: Endpoints
) -> None:
    with Bus(endpoints, Role.CLIENT, namespace="walker") as peer:
        wait_until(
            lambda: list(peer.session.get("srv/estop", payload=b"HELP")),
            what="an answer",
        )
    assert mode_of(served) is RobotMode.FAULT


def test_status_tells_mode_commander_and_refusals(
    served: ServedRobot, commander: RobotClient
) -> None:
    commander.send(WALKER.nominal + 1.0, tick=served.publish_tick())
    status = status_when(
        commander, lambda s: bool(s.refused), what="status with the refusal"
    )
    assert status.mode is RobotMode.ACTIVE
    assert status.commander == "ann"
    assert status.refused == {"first_command": 1}
    assert "rad from the held posture" in status.notice


@pytest.mark.parametrize("service", ["mode", "lease"])
def test_a_request_that_cannot_be_read_is_answered_with_the_field(
    served: ServedRobot, endpoints: Endpoints, service: str
) -> None:
    request = msgspec.msgpack.encode({"schema": SCHEMA_VERSION, "action": 3})
    with Bus(endpoints, Role.CLIENT, namespace="walker") as peer:
        replies = wait_until(
            lambda: list(peer.session.get(f"srv/{service}", payload=request)),
            what="an answer",
        )
    assert replies[0].ok is not None
    answer = msgspec.msgpack.decode(replies[0].ok.payload.to_bytes())
    assert not answer["accepted"]
    assert "action" in answer["detail"]
    assert mode_of(served) is RobotMode.HOLD


# Planner ---------------------------------------------------------------------------


def test_the_newest_reference_is_what_the_controller_gets(
    served: ServedRobot, commander: RobotClient, endpoints: Endpoints
) -> None:
    assert commander.reference() is None

    def reference(height_m: float) -> Reference:
        return Reference(
            schema=SCHEMA_VERSION,
            tick=0,
            stamp_ns=0,
            com=[0.0, 0.0, height_m],
            com_velocity=[0.0, 0.0, 0.0],
            com_acceleration=[0.0, 0.0, 0.0],
            base_quat_xyzw=[0.0, 0.0, 0.0, 1.0],
            posture=WALKER.nominal.tolist(),
            feet=[],
        )

    def height() -> float:
        got = commander.reference()
        return 0.0 if got is None else got.com[2]

    # Planners dial the robot as everyone does; it is the robot that passes them on.
    with Bus(endpoints, Role.CLIENT, namespace="walker") as planner:
        publisher = planner.publisher("ref", urgent=False)
        publisher.put(encode(reference(0.8)))
        publisher.put(encode(reference(0.9)))
        wait_until(lambda: height() == 0.9, what="the reference")


def test_a_truth_too_long_for_the_bus_is_told_of_once(
    served: ServedRobot, caplog: pytest.LogCaptureFixture
) -> None:
    plain = simplest_message(Truth)
    block = simplest_message(GroundBlock)
    long = msgspec.convert({**plain, "ground": [block] * 1000}, Truth)
    for _ in range(2):
        served.do(lambda server, _: server.publish_truth(long))
    (told,) = caplog.messages
    assert "with 1000 blocks of ground it is" in told
