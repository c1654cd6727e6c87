"""A record is played on the bus, for real subscribers."""

from __future__ import annotations

import json
import math
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest

from surefoot.robot_io.client_side.observer import Observer, Sample
from surefoot.robot_io.errors import RequestRefusedError
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.robot_side.replay_server import REFUSAL
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.topics import TICK_SENSORS
from tests.command import Surefoot, command, environment
from tests.nodes.processes import looking
from tests.support import PATIENCE_S, wait_until
from tests.surefoot.playback.conftest import Check
from tests.surefoot.playback.records import rewritten
from tests.surefoot.recording.mcap_reading import messages

DEPTH = 4096
CHANNELS = (
    *TICK_SENSORS,
    "joint_command",
    "reference",
    "settings_change",
    "stabilizer",
    "truth",
    "status",
)


@contextmanager
def playing(
    path: Path, endpoint_file: Path, *words: object
) -> Iterator[subprocess.Popen[str]]:
    """Run ``surefoot replay`` as a process."""
    process = subprocess.Popen(
        command("replay", path, "--endpoints", endpoint_file, *words),
        env=environment(),
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def watched(endpoints: Endpoints, channels: tuple[str, ...] = CHANNELS) -> list[Sample]:
    """Return all messages until the robot leaves, each channel in order."""
    samples: list[Sample] = []
    with Observer(
        load_robot("walker"), endpoints=endpoints, channels=channels, depth=DEPTH
    ) as observer:
        observer.connect(timeout_s=PATIENCE_S)

        def has_left() -> bool:
            samples.extend(observer.take(timeout_s=0.05))
            return not observer.robot_is_here

        wait_until(has_left, what="the end of the replay")
        samples.extend(observer.take(timeout_s=0.2))
    return samples


def by_channel(path: Path) -> dict[str, list[dict[str, Any]]]:
    said: dict[str, list[dict[str, Any]]] = {}
    for message in messages(path):
        said.setdefault(message.channel, []).append(message.content)
    return said


def test_a_subscriber_gets_every_message_in_order(
    record: Path, endpoints: Endpoints, endpoint_file: Path
) -> None:
    with playing(record, endpoint_file) as process:
        samples = watched(endpoints)
        assert process.wait(PATIENCE_S) == 0
    seen: dict[str, list[dict[str, Any]]] = {}
    for sample in samples:
        seen.setdefault(sample.channel, []).append(msgspec.msgpack.decode(sample.data))
    expected = by_channel(record)
    assert set(seen) == set(expected)
    for channel, said in expected.items():
        assert seen[channel] == said, channel


def test_a_record_of_a_replay_computes_the_same(
    record: Path,
    endpoint_file: Path,
    tmp_path: Path,
    surefoot_here: Surefoot,
    check: Check,
) -> None:
    again = tmp_path / "again.mcap"
    with playing(record, endpoint_file) as process:
        done = surefoot_here(
            *("record", "--raw", "--out", again, "--endpoints", endpoint_file),
            *("--json", "--wait", PATIENCE_S),
        )
        assert process.wait(PATIENCE_S) == 0
    assert done.returncode == 0, done.stderr
    counts = {entry["channel"]: entry for entry in json.loads(done.stdout)}
    assert [counts[name]["missing"] for name in TICK_SENSORS] == [0] * 4
    code, found = check(again)
    expected = by_channel(record)["joint_command"]
    assert (code, found["compared"]) == (0, len(expected))


def test_a_recorder_knows_that_a_part_is_over(
    record: Path, endpoint_file: Path, tmp_path: Path, surefoot_here: Surefoot
) -> None:
    """Though the robot's own end is not in that part."""
    part = tmp_path / "part.mcap"
    with playing(record, endpoint_file, "--until", 0.04) as process:
        done = surefoot_here(
            *("record", "--out", part, "--endpoints", endpoint_file),
            *("--json", "--wait", PATIENCE_S),
        )
        assert process.wait(PATIENCE_S) == 0
    assert done.returncode == 0, done.stderr
    last = by_channel(part)["status"][-1]
    assert (last["mode"], last["commander"]) == ("off", "")
    assert last["detail"] == "the replay is over"


def test_it_cannot_be_commanded_and_looks_like_the_robot(
    record: Path, endpoints: Endpoints, endpoint_file: Path
) -> None:
    expected = by_channel(record)
    commander = expected["joint_command"][0]["commander"]
    with (
        playing(record, endpoint_file, "--speed", 0.2) as process,
        looking(endpoints) as observer,
    ):
        wait_until(lambda: observer.stabilizers, what="the stabilizer")
        sight = wait_until(
            lambda: (
                (s := observer.latest_messages()).status
                and s.truth
                and s.stabilizer
                and s
            ),
            what="robot, truth and stabilizer",
        )
        assert sight.status.commander == commander
        requests: tuple[Callable[[], object], ...] = (
            observer.requests.stop_robot,
            lambda: observer.requests.push("torso", [9.0, 0.0, 0.0], duration_s=0.1),
            lambda: observer.requests.control("hold"),
            lambda: observer.requests.change_settings({"tsid.com_kp": [31.0]}),
            lambda: observer.requests.change_settings({}),
        )
        for request in requests:
            with pytest.raises(RequestRefusedError, match=REFUSAL):
                request()
        later = wait_until(
            lambda: (
                (s := observer.latest_messages()).status.tick > sight.status.tick and s
            ),
            what="the replay to go on",
        )
        assert later.status.mode is RobotMode.ACTIVE
        process.send_signal(signal.SIGINT)
        _, words = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in words


def test_a_stabilizer_is_told_that_it_is_a_replay(
    record: Path, endpoint_file: Path, surefoot_here: Surefoot
) -> None:
    with playing(record, endpoint_file, "--loop"):
        done = surefoot_here(
            *("stabilizer", "--controller", "hold", "--wait", PATIENCE_S),
            *("--endpoints", endpoint_file),
        )
    assert done.returncode == 1
    assert REFUSAL in done.stderr
    assert "Traceback" not in done.stderr


def test_part_of_a_record_that_is_cut_off_plays_at_another_speed(
    record: Path, endpoints: Endpoints, endpoint_file: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.mcap.partial"
    data = record.read_bytes()
    cut.write_bytes(data[: 3 * len(data) // 4])
    words = ("--from", 0.1, "--until", 0.4, "--speed", 0.5)
    with playing(cut, endpoint_file, *words) as process:
        samples = watched(endpoints, ("joints",))
        assert process.wait(PATIENCE_S) == 0
    ticks = [msgspec.msgpack.decode(sample.data)["tick"] for sample in samples]
    assert ticks == list(range(100, 400))
    # Never faster than asked for, whatever the machine does.
    taken_s = (samples[-1].received_ns - samples[0].received_ns) * 1e-9
    assert taken_s > 0.9 * 0.3 / 0.5


def test_readings_that_were_no_numbers_are_none_again(
    record: Path, endpoints: Endpoints, endpoint_file: Path, tmp_path: Path
) -> None:
    def spoil(channel: str, message: dict[str, Any]) -> dict[str, Any]:
        if channel == "imu" and message["tick"] == 50:
            message["angular_velocity"][1] = None
        return message

    path = rewritten(record, tmp_path / "spoilt.mcap", spoil)
    with playing(path, endpoint_file, "--until", 0.1):
        samples = watched(endpoints, ("imu",))
    read = [msgspec.msgpack.decode(sample.data) for sample in samples]
    assert [m["tick"] for m in read] == list(range(100))
    numbers = read[50]["angular_velocity"]
    assert [math.isnan(number) for number in numbers] == [False, True, False]


def test_a_loop_begins_again(
    record: Path, endpoints: Endpoints, endpoint_file: Path
) -> None:
    with (
        playing(record, endpoint_file, "--loop", "--until", 0.1),
        looking(endpoints) as observer,
    ):
        ticks: list[int] = []

        def has_begun_again() -> bool:
            sight = observer.latest_messages()
            if sight.joints is not None:
                ticks.append(sight.joints.tick)
            return any(later < earlier for earlier, later in pairwise(ticks))

        wait_until(has_begun_again, what="the second round")


def test_a_port_in_use_is_code_3(record: Path, surefoot_here: Surefoot) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        where = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = surefoot_here("replay", record, "--now", "--listen", where)
    assert done.returncode == 3
    assert "in use" in done.stderr
    assert "Traceback" not in done.stderr
