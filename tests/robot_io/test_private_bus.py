"""The private address of a run's two processes."""

from __future__ import annotations

import stat
import tempfile
from pathlib import Path

import pytest

from surefoot.robot_io.bus.bus import LONGEST_SOCKET_PATH, Bus, private_bus
from surefoot.robot_io.bus.session import Role
from surefoot.schemas.topics import ALIVE_ROBOT
from tests.support import PATIENCE_S, wait_until


def test_two_sessions_meet_where_nobody_else_can_go() -> None:
    with private_bus() as endpoints:
        (locator,) = endpoints.listen
        assert endpoints.connect == [locator]
        folder = Path(locator.removeprefix("unixsock-stream/")).parent
        assert stat.S_IMODE(folder.stat().st_mode) == stat.S_IRWXU
        seen: list[str] = []
        with (
            Bus(endpoints, Role.ROBOT, namespace="walker") as robot,
            Bus(
                endpoints, Role.CLIENT, namespace="walker", timeout_s=PATIENCE_S
            ) as client,
        ):
            robot.announce(ALIVE_ROBOT)
            client.watch_presence(ALIVE_ROBOT, lambda key, is_there: seen.append(key))
            wait_until(lambda: seen, what="the robot to be seen")
    assert not folder.exists()


def test_a_path_too_long_for_a_socket_falls_back_to_a_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = tmp_path / ("d" * LONGEST_SOCKET_PATH)
    deep.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    with private_bus() as endpoints:
        assert endpoints.listen[0].startswith("tcp/127.0.0.1:")
        assert endpoints.connect == endpoints.listen
