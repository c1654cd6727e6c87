"""Times messages to and fro on loopback, with the bus's own settings."""

from __future__ import annotations

import time

import zenoh
from zenoh.handlers import Callback

from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.robot_io.errors import RobotUnreachableError
from surefoot.schemas.endpoints import Endpoints

ROUND_TRIPS = 200
_WARM_UP = 20
_ANSWER_S = 2.0
_NAMESPACE = "loopback"
_BYTES = 600
"""Size of a message with a robot's joints."""
_POLL_S = 0.002
_MS_PER_S = 1e3


def measure_loopback(endpoints: Endpoints) -> tuple[float, float]:
    """Open both ends of a bus in this process and send messages to and fro.

    Args:
        endpoints: where the two meet; must be free.

    Returns:
        Median and 99th percentile of the round trip [ms].

    Raises:
        EndpointError: cannot listen there.
        RobotUnreachableError: no connection, or no answer.
    """
    with (
        Bus(endpoints, Role.ROBOT, namespace=_NAMESPACE) as far,
        Bus(endpoints, Role.CLIENT, namespace=_NAMESPACE) as near,
    ):
        back = far.publisher("back", urgent=True, flush=True)

        def answer(sample: zenoh.Sample) -> None:
            back.put(sample.payload)

        far.session.declare_subscriber("forth", Callback(answer, indirect=False))
        forth = near.publisher("forth", urgent=True, flush=True)
        channel = near.channel("back", depth=1)
        payload = bytes(_BYTES)

        def round_trip() -> float:
            begin = time.monotonic()
            forth.put(payload)
            if channel.wait(begin + _ANSWER_S) is None:
                raise RobotUnreachableError(
                    f"no answer on {endpoints.listen[0]} within {_ANSWER_S:g} s"
                )
            return time.monotonic() - begin

        _wait_for_match(forth, back)
        for _ in range(_WARM_UP):
            round_trip()
        times = sorted(round_trip() for _ in range(ROUND_TRIPS))
    return (
        _MS_PER_S * times[ROUND_TRIPS // 2],
        _MS_PER_S * times[-ROUND_TRIPS // 100],
    )


def _wait_for_match(*publishers: zenoh.Publisher) -> None:
    """Until each has its subscriber: what is sent before is lost.

    Raises:
        RobotUnreachableError: not in time.
    """
    end = time.monotonic() + _ANSWER_S
    while not all(_matches(publisher) for publisher in publishers):
        if time.monotonic() >= end:
            raise RobotUnreachableError(
                f"the two ends did not find each other within {_ANSWER_S:g} s"
            )
        time.sleep(_POLL_S)  # a listener would need a thread for this one moment


def _matches(publisher: zenoh.Publisher) -> bool:
    status = publisher.matching_status
    return bool(getattr(status, "matching", status))
