"""Recorded ground in messages of other programs, whole and damaged."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer

from surefoot.recording.write import LogTimes
from surefoot.sim_robot.catalogue import ScenarioError
from tests.sim_robot.ground_files import assert_refused, read


def _mcap(
    messages: list[bytes],
    *,
    encoding: str = "json",
    compression: CompressionType = CompressionType.NONE,
    first_ns: int = 10**9,
    times: str = "",
    **about: Any,
) -> bytes:
    file = io.BytesIO()
    writer = Writer(file, compression=compression, **about)
    writer.start()
    schema = writer.register_schema("imu", "jsonschema", b"{}")
    channel = writer.register_channel("/imu", encoding, schema, {"log_time": times})
    for index, message in enumerate(messages):
        log_ns = first_ns + 50_000_000 * index
        writer.add_message(channel, log_ns, message, log_ns)
    writer.finish()
    return file.getvalue()


@pytest.mark.parametrize(
    "stamp",
    [
        lambda ns: {"stamp_ns": ns},
        lambda ns: {"stamp_ns": float(ns)},
        lambda ns: {"stamp_ns": str(ns)},
        lambda ns: {"header": {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}}},
        lambda ns: {"header": {"stamp": {"secs": ns // 10**9, "nsecs": ns % 10**9}}},
        lambda ns: {"header": {"stamp": {"sec": ns // 10**9, "nsec": ns % 10**9}}},
    ],
)
@pytest.mark.parametrize("encoding", ["json", "msgpack"])
def test_messages_count_from_when_they_were_measured(
    tmp_path: Path, stamp: Callable[[int], dict[str, object]], encoding: str
) -> None:
    encode = (
        msgpack.packb if encoding == "msgpack" else lambda m: json.dumps(m).encode()
    )
    messages = [
        encode({"a": [-1.0, float(index)], **stamp(5 * 10**9 + 10**7 * index)})
        for index in range(4)
    ]
    swapped = [messages[index] for index in (0, 2, 1, 3)]  # by the logger
    repeated = [messages[index] for index in (0, 0, 1, 1, 1, 2, 2, 3)]  # slow sensor
    for each in (messages, swapped, repeated):
        content = _mcap(each, encoding=encoding)
        record = read(tmp_path / "a.mcap", content, channel="/imu", field="a.1")
        assert record.times == pytest.approx([0.0, 0.01, 0.02, 0.03])
        assert record.values.tolist() == [0.0, 1.0, 2.0, 3.0]


GOOD = [b'{"a": 1}'] * 50


@pytest.mark.parametrize("index_types", [IndexType.ALL, IndexType.NONE])
def test_mcap_without_channels_in_its_summary(
    tmp_path: Path, index_types: IndexType
) -> None:
    messages = [json.dumps({"a": value}).encode() for value in (0.5, 1.0, 1.5, 2.0)]
    content = _mcap(messages, repeat_channels=False, index_types=index_types)
    record = read(tmp_path / "a.mcap", content, channel="imu", field="a")
    assert record.values.tolist() == [0.5, 1.0, 1.5, 2.0]
    assert_refused(tmp_path / "a.mcap", content, "it has /imu", channel="ft", field="a")
    with pytest.raises(ScenarioError, match="no 'b'"):
        read(tmp_path / "a.mcap", content, channel="imu", field="b.0")


def test_a_channel_needs_no_slash(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    slashed, plain = (
        read(path, _mcap(GOOD), channel=name, field="a") for name in ("/imu", "imu")
    )
    np.testing.assert_array_equal(slashed.values, plain.values)


@pytest.mark.parametrize(("period_ns", "interval_s"), [(10**6, 0.05), (None, 0.07)])
def test_times_are_simulated_ones_where_stamps_tell_how_fast_a_machine_was(
    tmp_path: Path, period_ns: int | None, interval_s: float
) -> None:
    stamped = [b'{"a": 1, "stamp_ns": %d}' % (7 * 10**7 * i) for i in range(1, 50)]
    content = _mcap(stamped, times=LogTimes(period_ns).meaning)
    record = read(tmp_path / "a.mcap", content, channel="imu", field="a")
    assert np.diff(record.times) == pytest.approx(interval_s)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (_mcap(GOOD)[:5], "cannot be read as MCAP"),
        (_mcap(GOOD)[:8], "cannot be read as MCAP"),
        (_mcap(GOOD)[:-100], "cannot be read as MCAP .*cut off"),
        (_mcap([b'{"a": %s}' % (b"[" * 10**5)]), "MCAP .RecursionError"),
        (_mcap([msgpack.packb(1)[:0]], encoding="msgpack"), "cannot be read as MCAP"),
    ],
)
def test_a_damaged_mcap_is_called_that(
    tmp_path: Path, content: bytes, words: str
) -> None:
    assert_refused(tmp_path / "a.mcap", content, words, channel="/imu", field="a")


@pytest.mark.parametrize("compression", list(CompressionType))
def test_no_byte_of_an_mcap_makes_a_traceback(
    tmp_path: Path, compression: CompressionType
) -> None:
    sound, random = _mcap(GOOD, compression=compression), np.random.default_rng(0)
    refused = 0
    for _ in range(150):
        content = bytearray(sound)
        for at in random.integers(0, len(sound), 3):
            content[at] = random.integers(256)
        try:
            read(tmp_path / "a.mcap", bytes(content), channel="/imu", field="a")
        except ScenarioError:
            refused += 1
    assert refused > 50


@pytest.mark.parametrize(
    ("message", "first_ns", "key", "words"),
    [
        (b'{"a": 1%s}' % (400 * b"0"), 0, "field", "is inf in a message"),
        (b'{"a": NaN}', 0, "field", "is nan in a message"),
        (b'{"a": 1}', 2**63, "channel", "stamp 9223372036854775808 ns"),
        (b'{"a": 1, "stamp_ns": 1%s}' % (400 * b"0"), 0, "channel", "no sound clock"),
    ],
)
def test_numbers_no_message_should_have(
    tmp_path: Path, message: bytes, first_ns: int, key: str, words: str
) -> None:
    content = _mcap([message] * 4, first_ns=first_ns)
    with pytest.raises(ScenarioError, match=words) as caught:
        read(tmp_path / "a.mcap", content, channel="/imu", field="a")
    assert caught.value.field == key
