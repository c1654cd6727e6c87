"""A robot on a bus of its own, and clients of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from surefoot.robot_io.client_side.client import RobotClient
from surefoot.schemas.endpoints import Endpoints
from tests.robot_io.client_at_work import WALKER, MakeClient, new_client
from tests.robot_io.secured import Authority
from tests.robot_io.served_robot import ServedRobot, serving
from tests.support import PATIENCE_S


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    """Return certificates; one set per module, since making keys takes long."""
    return Authority(tmp_path_factory.mktemp("authority") / "certs")


@pytest.fixture
def served(endpoints: Endpoints) -> Iterator[ServedRobot]:
    with serving(WALKER, endpoints) as robot:
        yield robot


@pytest.fixture
def make_client(endpoints: Endpoints) -> Iterator[MakeClient]:
    with ExitStack() as stack:

        def make(identity: str) -> RobotClient:
            client = stack.enter_context(new_client(endpoints, identity))
            assert client.connect(timeout_s=PATIENCE_S)
            return client

        yield make


@pytest.fixture
def commander(served: ServedRobot, make_client: MakeClient) -> RobotClient:
    """Return a client that has taken command."""
    client = make_client("ann")
    client.take_lease()
    client.enable()
    return client
