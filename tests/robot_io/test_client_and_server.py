"""Client and server over real Zenoh on this host."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import msgspec
import numpy as np
import pytest

from robot_io.bus import Bus
from robot_io.client import RobotClient
from robot_io.errors import RequestRefusedError, RobotUnreachableError
from robot_io.gate import CommandGate
from robot_io.robot import load_robot
from robot_io.server import RobotServer
from robot_io.service_caller import ServiceCaller
from robot_io.session import Role
from robot_io.stop_request import StopRequest
from schemas.codec import encode
from schemas.endpoints import Endpoints
from schemas.messages import (
    SCHEMA_VERSION,
    JointCommand,
    LeaseRequest,
    ModeRequest,
    Reference,
    RobotMode,
    RobotStatus,
)
from schemas.topics import ALIVE_STABILIZER
from tests.robot_io.sensor_messages import snapshot_at
from tests.robot_io.served_robot import ServedRobot, serving
from tests.support import DEADLINE_S, wait_until

WALKER = load_robot("walker")
MakeClient = Callable[..., RobotClient]


def new_client(
    endpoints: Endpoints, identity: str, stop: StopRequest | None = None
) -> RobotClient:
    """A client in order, not connected yet."""
    return RobotClient(
        WALKER,
        endpoints=endpoints,
        identity=identity,
        in_order=True,
        stop=stop or StopRequest(),
    )


@pytest.fixture
def served(endpoints: Endpoints) -> Iterator[ServedRobot]:
    with serving(WALKER, endpoints) as robot:
        yield robot


@pytest.fixture
def make_client(endpoints: Endpoints) -> Iterator[MakeClient]:
    with ExitStack() as stack:

        def make(identity: str) -> RobotClient:
            client = stack.enter_context(new_client(endpoints, identity))
            assert client.connect(timeout_s=DEADLINE_S)
            return client

        yield make


@pytest.fixture
def commander(served: ServedRobot, make_client: MakeClient) -> RobotClient:
    """A client that has taken command."""
    client = make_client("ann")
    client.take_lease()
    client.enable()
    return client


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
    reading = commander.wait_snapshot(timeout_s=DEADLINE_S)
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
        assert server.wait_until_active(now_s=0.0, timeout_s=DEADLINE_S)
        for tick in range(100):
            gate.begin_tick(now_s=tick * 1e-3)
            server.publish_sensors(snapshot_at(tick), stamp_ns=0)
            answer = server.wait_answer(tick, now_s=tick * 1e-3, timeout_s=DEADLINE_S)
            assert answer is not None
            assert answer.command.tick == tick
            assert answer.verdict.accepted
        gate.authority.finish("over")
        server.publish_status(now_s=0.1, at_once=True)
    assert client.answered == 100


class ThreadedClient:
    """Answers every tick with the nominal posture until the robot is off."""

    def __init__(self, make_client: MakeClient) -> None:
        self.answered = 0
        self._thread = threading.Thread(target=self._run, args=(make_client,))

    def __enter__(self) -> ThreadedClient:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(DEADLINE_S)

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
    assert caught.value.reason == "ann holds the lease, bob does not"
    tick = served.publish_tick()
    second.send(WALKER.nominal + 0.001, tick=tick)
    wait_until(lambda: refused_by(served) == {"lease": 1}, what="the refusal")
    assert np.array_equal(posture_of(served), WALKER.nominal)


def test_leaving_gives_the_lease_back(
    served: ServedRobot, endpoints: Endpoints, make_client: MakeClient
) -> None:
    with new_client(endpoints, "ann") as first:
        first.connect(timeout_s=DEADLINE_S)
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
            timeout_s=DEADLINE_S,
            robot_is_here=lambda: True,
        )
        take = LeaseRequest(schema=SCHEMA_VERSION, action="take", commander="ann")
        enable = ModeRequest(schema=SCHEMA_VERSION, action="enable", commander="ann")
        services.ask("srv/lease", take)
        assert services.ask("srv/mode", enable).mode is RobotMode.ACTIVE
    wait_until(lambda: mode_of(served) is RobotMode.HOLD, what="HOLD")
    assert served.do(lambda _, gate: gate.authority.reason) == "ann is gone"
    make_client("bob").take_lease()


# Modes ----------------------------------------------------------------------------


def test_an_e_stop_comes_from_anyone_and_latches(
    served: ServedRobot, commander: RobotClient, make_client: MakeClient
) -> None:
    bystander = make_client("eve")
    assert bystander.stop_robot().mode is RobotMode.FAULT
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
    assert "rad from the held posture" in status.reason


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
    assert "action" in answer["reason"]
    assert mode_of(served) is RobotMode.HOLD


# Hostile ---------------------------------------------------------------------------


@pytest.fixture
def raw_command(served: ServedRobot, endpoints: Endpoints) -> Iterator[Callable]:
    """Puts any bytes on the command key."""
    with Bus(endpoints, Role.CLIENT, namespace="walker") as peer:
        publisher = peer.publisher("cmd/joints", urgent=True)
        wait_until(lambda: publisher.matching_status.matching, what="the robot")
        yield publisher.put


def joint_command(**changes: object) -> JointCommand:
    command = JointCommand(
        schema=SCHEMA_VERSION,
        tick=0,
        stamp_ns=0,
        q=WALKER.nominal.tolist(),
        commander="ann",
        sequence=10**6,
    )
    return msgspec.structs.replace(command, **changes)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "malformed"),
        (b"\xff" * 16, "malformed"),
        (b"x" * 5000, "malformed"),
        (encode(joint_command(q=WALKER.nominal[1:].tolist())), "malformed"),
        (encode(joint_command(q=[float("nan")] * WALKER.n_a)), "malformed"),
        (encode(joint_command(schema=SCHEMA_VERSION + 1)), "schema"),
        (encode(joint_command(commander="bob")), "lease"),
        (encode(joint_command(tick=5000)), "future"),
        (encode(joint_command(q=(WALKER.nominal + 9.0).tolist())), "first_command"),
    ],
    ids=[
        "empty", "as long as a token", "long", "short of a joint", "nan",
        "other version", "other commander", "tick to come", "far away",
    ],
)  # fmt: skip
def test_bad_commands_are_counted_under_their_reason_and_move_nothing(
    served: ServedRobot,
    commander: RobotClient,
    raw_command: Callable[[bytes], None],
    data: bytes,
    reason: str,
) -> None:
    served.publish_tick()
    raw_command(data)
    wait_until(lambda: refused_by(served) == {reason: 1}, what=f"{reason} refused")
    assert np.array_equal(posture_of(served), WALKER.nominal)
    assert mode_of(served) is RobotMode.ACTIVE


def test_a_thousand_bad_commands_leave_the_commander_undisturbed(
    served: ServedRobot, commander: RobotClient, raw_command: Callable[[bytes], None]
) -> None:
    rng = np.random.default_rng(0)
    good = bytearray(encode(joint_command(commander="bob")))
    count = 1000
    for index in range(count):
        data = good.copy()
        data[rng.integers(len(data))] = rng.integers(256)
        raw_command(bytes(data))
        if index % 100 == 0:
            commander.send(WALKER.nominal, tick=served.publish_tick())
        done = index + 1
        wait_until(
            lambda done=done: sum(refused_by(served).values()) == done,
            what=f"{done} refusals",
        )
    assert np.array_equal(posture_of(served), WALKER.nominal)
    assert mode_of(served) is RobotMode.ACTIVE
    assert set(refused_by(served)) <= {"malformed", "schema", "lease"}


def test_a_replayed_command_is_refused(
    served: ServedRobot, commander: RobotClient, raw_command: Callable[[bytes], None]
) -> None:
    tick = served.publish_tick()
    data = encode(joint_command(tick=tick))
    raw_command(data)
    raw_command(data)
    wait_until(lambda: refused_by(served) == {"sequence": 1}, what="the refusal")


# Presence --------------------------------------------------------------------------


def test_no_robot_is_an_error_that_names_endpoint_and_limit(
    endpoints: Endpoints,
) -> None:
    with (
        new_client(endpoints, "ann") as client,
        pytest.raises(RobotUnreachableError, match=r"within 0.2 s.*is the robot") as e,
    ):
        client.connect(timeout_s=0.2)
    assert endpoints.connect[0] in str(e.value)


def test_something_else_that_listens_is_not_taken_for_the_robot(
    endpoints: Endpoints,
) -> None:
    with (
        Bus(endpoints, Role.ROBOT, namespace="other"),
        new_client(endpoints, "ann") as client,
        pytest.raises(RobotUnreachableError, match="no robot 'walker' is ready"),
    ):
        client.connect(timeout_s=0.2)


def test_the_client_notices_that_the_robot_is_gone(endpoints: Endpoints) -> None:
    with new_client(endpoints, "ann") as client:
        with serving(WALKER, endpoints):
            client.connect(timeout_s=DEADLINE_S)
            client.take_lease()
        wait_until(lambda: not client.robot_is_here, what="the robot to be gone")
        assert client.wait_snapshot(timeout_s=DEADLINE_S) is None, "the wait is ended"
        with pytest.raises(RobotUnreachableError, match="went away"):
            client.enable()


def test_the_client_may_come_before_the_robot(endpoints: Endpoints) -> None:
    started = threading.Event()
    over = threading.Event()

    def robot() -> None:
        started.wait(DEADLINE_S)
        with serving(WALKER, endpoints):
            over.wait(DEADLINE_S)

    thread = threading.Thread(target=robot)
    thread.start()
    with new_client(endpoints, "ann") as client:
        started.set()
        assert client.connect(timeout_s=DEADLINE_S)
        client.take_lease()
        client.enable()
    over.set()
    thread.join()


def test_a_stop_request_ends_the_robots_waits(endpoints: Endpoints) -> None:
    stop = StopRequest()
    stop.set("a test")
    gate = CommandGate(WALKER, WALKER.nominal)
    with RobotServer(WALKER, gate, endpoints=endpoints, stop=stop) as server:
        assert not server.wait_until_active(now_s=0.0, timeout_s=None)
        assert server.wait_answer(0, now_s=0.0, timeout_s=DEADLINE_S) is None


def test_a_stop_request_ends_the_clients_waits(
    served: ServedRobot, endpoints: Endpoints
) -> None:
    stop = StopRequest()
    with new_client(endpoints, "ann", stop) as client:
        assert client.connect(timeout_s=DEADLINE_S)
        stop.set("a test")
        begin = time.monotonic()
        assert client.wait_snapshot(timeout_s=DEADLINE_S) is None
        assert time.monotonic() < begin + DEADLINE_S
    with new_client(endpoints, "bob", stop) as late:
        assert not late.connect(timeout_s=DEADLINE_S)


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
