"""No robot is taken for another: descriptions and instances on Zenoh."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.client_side.listener import Listener
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.client_side.requests import ServiceCaller
from surefoot.robot_io.client_side.robot_watch import CROWD_S
from surefoot.robot_io.conformance.run import check_conformance
from surefoot.robot_io.errors import (
    RequestRefusedError,
    RobotMismatchError,
    SecondRobotError,
)
from surefoot.robot_io.identity import describe, new_identity
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.relay.relay import Relay
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.replay_server import REFUSAL, ReplayServer
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    EstopRequest,
    LeaseRequest,
    RobotMode,
    ServiceReply,
)
from surefoot.schemas.reasons import RequestRefusal
from surefoot.schemas.relay_plan import RelayPlan
from tests.robot_io.client_at_work import new_client
from tests.robot_io.meeting_places import meeting_place
from tests.robot_io.served_robot import ServedRobot, serving
from tests.robot_io.strange_robots import MIRRORED, WALKER
from tests.support import PATIENCE_S, free_port, wait_until

HARMONIC = load_robot("walker", servo_profile="harmonic")
DIFFERENT = r"robot 'walker' on the bus is not ours.*differs in: joints, feet; give bo"


@pytest.fixture(params=[False, True], ids=["direct", "routed"])
def place(request: pytest.FixtureRequest) -> Iterator[Endpoints]:
    with meeting_place(routed=request.param) as endpoints:
        yield endpoints


def as_client(robot: Robot, endpoints: Endpoints) -> RobotClient:
    return new_client(endpoints, "ann", robot=robot)


@contextmanager
def caller(endpoints: Endpoints, **how: Callable) -> Iterator[ServiceCaller]:
    """Return a client that has not checked which robot it asks."""
    with Bus(endpoints, Role.CLIENT, namespace="walker") as bus:
        yield ServiceCaller(
            bus.session,
            joint_count=WALKER.n_a,
            timeout_s=PATIENCE_S,
            robot_is_here=lambda: True,
            check=how.get("check", lambda reply: None),
        )


def holder(served: ServedRobot) -> str:
    return served.do(lambda server, gate: gate.modes.lease.holder)


# Another description ---------------------------------------------------------------


@pytest.mark.parametrize(("ours", "theirs"), [(MIRRORED, WALKER), (WALKER, MIRRORED)])
def test_a_commander_refuses_a_robot_of_another_description(
    place: Endpoints, ours: Robot, theirs: Robot
) -> None:
    with serving(theirs, place) as served, as_client(ours, place) as client:
        with pytest.raises(RobotMismatchError, match=DIFFERENT):
            client.connect(timeout_s=PATIENCE_S)
        assert holder(served) == ""


def test_another_servo_profile_is_another_robot(endpoints: Endpoints) -> None:
    with serving(WALKER, endpoints), as_client(HARMONIC, endpoints) as client:
        words = "differs in: servo; .*--servo-profile"
        with pytest.raises(RobotMismatchError, match=words):
            client.connect(timeout_s=PATIENCE_S)


def test_the_robot_refuses_a_commander_of_another_description(
    place: Endpoints,
) -> None:
    with serving(WALKER, place) as served, caller(place) as services:
        strange = served.lease_request("eve", description=describe(MIRRORED))
        with pytest.raises(RequestRefusedError) as caught:
            services.ask("srv/lease", strange)
        reason = caught.value.detail
        assert caught.value.refusal is RequestRefusal.WRONG_ROBOT
        assert reason.startswith(
            "eve: its robot description differs in: joints, feet; give both sides the "
            "same robot file"
        )
        assert holder(served) == ""
        told = served.do(lambda server, gate: gate.modes.notice)
        assert told == f"request refused: {reason}"
        assert services.ask("srv/lease", served.lease_request("ann")).accepted


def test_the_robot_refuses_who_means_another_instance(place: Endpoints) -> None:
    with serving(WALKER, place) as served, caller(place) as services:
        with pytest.raises(
            RequestRefusedError, match=r"means the robot of instance 0bad0bad, this"
        ):
            services.ask("srv/lease", served.lease_request("eve", robot="0bad0bad"))
        assert holder(served) == ""


def test_every_answer_tells_instance_and_description(endpoints: Endpoints) -> None:
    with serving(WALKER, endpoints) as served, caller(endpoints) as services:
        reply = services.ask("srv/lease", served.lease_request("ann"))
        identity = served.server.identity
        assert (reply.instance, reply.description) == identity
        assert reply.description == describe(WALKER)


def test_an_answer_of_another_robot_is_not_taken_but_an_e_stop_is(
    endpoints: Endpoints,
) -> None:
    def strange(reply: ServiceReply) -> None:
        raise RobotMismatchError("another one")

    with (
        serving(WALKER, endpoints) as served,
        caller(endpoints, check=strange) as services,
    ):
        with pytest.raises(RobotMismatchError):
            services.ask("srv/lease", served.lease_request("ann"))
        stop = EstopRequest(schema=SCHEMA_VERSION, source="eve")
        assert services.ask("srv/estop", stop).mode is RobotMode.FAULT


@pytest.mark.parametrize("ours", [MIRRORED, HARMONIC], ids=["mirrored", "harmonic"])
def test_who_looks_on_refuses_a_robot_of_another_description(
    place: Endpoints, ours: Robot
) -> None:
    with (
        serving(WALKER, place),
        Observer(ours, endpoints=place) as observer,
        Listener(ours, endpoints=place, patterns=["**"]) as listener,
    ):
        for onlooker in (observer, listener):
            with pytest.raises(RobotMismatchError, match="is not ours"):
                onlooker.connect(timeout_s=PATIENCE_S)
        with pytest.raises(RobotMismatchError, match="is not ours"):
            check_conformance(ours, endpoints=place, timeout_s=PATIENCE_S)


def relay_beside(place: Endpoints, replace: Callable[[], None] | None = None) -> None:
    """Run a relay of the Walker until something ends it."""
    there = [f"tcp/127.0.0.1:{free_port()}"]
    both = Endpoints(listen=there, connect=place.router or place.connect)
    relay = Relay(WALKER, RelayPlan(name="clear"), seed=0)
    relay.run(both, stop=StopRequest(), wait_s=PATIENCE_S, on_ready=replace)


def test_a_relay_refuses_a_robot_of_another_description(place: Endpoints) -> None:
    with (
        serving(MIRRORED, place),
        pytest.raises(RobotMismatchError, match=DIFFERENT),
    ):
        relay_beside(place)


def test_a_relay_ends_when_another_robot_comes_in_the_place_of_ours(
    routed: Endpoints,
) -> None:
    with ExitStack() as first, ExitStack() as second:
        first.enter_context(serving(WALKER, routed))

        def replace() -> None:
            first.close()
            second.enter_context(serving(MIRRORED, routed))

        with pytest.raises(RobotMismatchError, match=DIFFERENT):
            relay_beside(routed, replace)


def test_who_looks_on_stays_with_a_robot_that_was_started_anew(
    routed: Endpoints,
) -> None:
    with Observer(WALKER, endpoints=routed, channels=("status",)) as observer:
        with serving(WALKER, routed):
            observer.connect(timeout_s=PATIENCE_S)
            assert observer.robot_is_here
        wait_until(lambda: not observer.robot_is_here, what="the robot to be gone")
        with serving(WALKER, routed):
            wait_until(lambda: observer.robot_is_here, what="the robot to be back")
            assert observer.requests.stop_robot().accepted
        wait_until(lambda: not observer.robot_is_here, what="the robot to be gone")
        with serving(MIRRORED, routed), pytest.raises(RobotMismatchError):
            wait_until(lambda: observer.robot_is_here, what="another robot")


def test_a_robot_that_does_not_tell_who_it_is_is_refused(endpoints: Endpoints) -> None:
    with (
        Bus(endpoints, Role.ROBOT, namespace="walker") as bus,
        as_client(WALKER, endpoints) as client,
    ):
        bus.announce("alive/robot")
        with pytest.raises(RobotMismatchError, match="use the same version"):
            client.connect(timeout_s=PATIENCE_S)


# Two robots ------------------------------------------------------------------------


def test_a_second_robot_of_the_namespace_refuses_to_start(routed: Endpoints) -> None:
    with serving(WALKER, routed) as first:
        ours = first.server.identity.instance
        with (
            pytest.raises(SecondRobotError, match=f"instance {ours}") as caught,
            serving(MIRRORED, routed),
        ):
            pass
        assert "`namespace` of its own" in str(caught.value)
        with as_client(WALKER, routed) as client:
            assert client.connect(timeout_s=PATIENCE_S)
            assert client.take_lease().instance == ours


def test_a_robot_waits_for_what_a_dead_one_left_behind(
    routed: Endpoints, caplog: pytest.LogCaptureFixture
) -> None:
    with ExitStack() as dead:
        bus = dead.enter_context(Bus(routed, Role.ROBOT, namespace="walker"))
        bus.announce(new_identity(WALKER).token)

        def bury(record: object) -> bool:
            dead.close()
            return True

        caplog.handler.addFilter(bury)  # at the moment in which it says that it waits
        with serving(WALKER, routed), as_client(WALKER, routed) as client:
            assert client.connect(timeout_s=PATIENCE_S)
    assert "waiting for it to go" in caplog.text


def test_clients_refuse_two_robots_by_name(place: Endpoints) -> None:
    second = new_identity(WALKER)
    with (
        serving(WALKER, place) as served,
        Bus(place, Role.CLIENT, namespace="walker") as elsewhere,
    ):
        elsewhere.announce(second.token)
        both = sorted([served.server.identity.instance, second.instance])
        words = f"2 robots 'walker' are on the bus .instances {both[0]} and {both[1]}"
        with (
            as_client(WALKER, place) as client,
            Observer(WALKER, endpoints=place) as observer,
        ):
            for dialing in (client, observer):
                with pytest.raises(SecondRobotError, match=words):
                    dialing.connect(timeout_s=PATIENCE_S)


def test_a_commander_leaves_when_a_second_robot_comes_to_stay(
    routed: Endpoints,
) -> None:
    with serving(WALKER, routed) as served, as_client(WALKER, routed) as client:
        assert client.connect(timeout_s=PATIENCE_S)
        client.take_lease()
        with Bus(routed, Role.CLIENT, namespace="walker") as elsewhere:
            elsewhere.announce(new_identity(WALKER).token)
            wait_until(lambda: len(client._watch._there) == 2, what="the second robot")
            assert client.robot_is_here, "it may be about to give way"
        wait_until(lambda: len(client._watch._there) == 1, what="it to be gone")
        assert client.robot_is_here
        with Bus(routed, Role.CLIENT, namespace="walker") as elsewhere:
            elsewhere.announce(new_identity(WALKER).token)
            with pytest.raises(SecondRobotError, match="2 robots 'walker'"):
                wait_until(
                    lambda: not client.robot_is_here,
                    what="the commander to notice",
                    patience_s=PATIENCE_S + CROWD_S,
                )
        assert holder(served) == "ann"
        client.release()
        assert holder(served) == ""


def test_one_request_does_not_take_two_robots(routed: Endpoints) -> None:
    """Even where both are there: who is not meant refuses, and its answer is known."""
    with (
        serving(WALKER, routed) as served,
        Bus(routed, Role.ROBOT, namespace="walker") as bus,
        as_client(WALKER, routed) as client,
    ):
        other = new_identity(WALKER)
        assert client.connect(timeout_s=PATIENCE_S)
        served.do(lambda server, gate: gate.modes.stop("a test"))
        found = client._watch.found
        assert found == served.server.identity
        reply = ServiceReply(
            schema=SCHEMA_VERSION,
            accepted=True,
            refusal=RequestRefusal.NONE,
            detail="",
            mode=RobotMode.HOLD,
            commander="ann",
            q_command=WALKER.nominal.tolist(),
            instance=other.instance,
            description=other.description,
            pace="lockstep",
        )
        bus.queryable("srv/mode", lambda q: q.reply(q.key_expr, encode(reply)))
        words = "|".join(map(re.escape, sorted([found.instance, other.instance])))
        with pytest.raises(SecondRobotError, match=words):
            wait_until(
                lambda: asked_in_vain(client), what="the answer of the other one"
            )


def asked_in_vain(client: RobotClient) -> bool:
    """Return whether a request was accepted that our own robot refuses."""
    try:
        client.request_mode("enable")
    except RequestRefusedError:
        return False
    return True


# Replay ----------------------------------------------------------------------------


@contextmanager
def replaying(robot: Robot, endpoints: Endpoints) -> Iterator[ReplayServer]:
    with ReplayServer(robot, endpoints=endpoints, stop=StopRequest()) as server:
        yield server


def test_a_replay_is_of_the_recorded_robot(place: Endpoints) -> None:
    with replaying(MIRRORED, place):
        with Observer(MIRRORED, endpoints=place, channels=("status",)) as observer:
            observer.connect(timeout_s=PATIENCE_S)
        with as_client(MIRRORED, place) as client:
            assert client.connect(timeout_s=PATIENCE_S)
            with pytest.raises(RequestRefusedError, match=REFUSAL):
                client.take_lease()
        with (
            Observer(WALKER, endpoints=place) as stranger,
            pytest.raises(RobotMismatchError, match=DIFFERENT),
        ):
            stranger.connect(timeout_s=PATIENCE_S)


def test_a_replay_does_not_start_beside_a_robot(routed: Endpoints) -> None:
    with (
        serving(WALKER, routed),
        pytest.raises(SecondRobotError, match="already"),
        replaying(WALKER, routed),
    ):
        pass
    with (
        replaying(WALKER, routed),
        pytest.raises(SecondRobotError, match="already"),
        serving(WALKER, routed),
    ):
        pass


def test_two_replays_are_two_instances(place: Endpoints) -> None:
    seen = []
    for _ in range(2):
        with replaying(WALKER, place), caller(place) as services:
            lease = LeaseRequest(
                schema=SCHEMA_VERSION,
                action="take",
                commander="ann",
                robot="",
                description="",
            )
            with pytest.raises(RequestRefusedError, match=REFUSAL):
                services.ask("srv/lease", lease)
            with as_client(WALKER, place) as client:
                assert client.connect(timeout_s=PATIENCE_S)
                seen.append(client._watch.found)
    assert seen[0].instance != seen[1].instance
    assert seen[0].description == seen[1].description == describe(WALKER)
