"""Recorded ground in files of other programs, whole and damaged."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer

from surefoot.recording.write import LogTimes
from surefoot.schemas.motions import STANDARD_GRAVITY, RecordedMotion
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.ground_records import GroundRecord, read_record
from surefoot.sim_robot.recorded import recorded_track

KNET = """Origin Time       2026/11/26 12:00:00
{more}Sampling Freq(Hz) {rate}
Duration Time(s)  {lasts}
Dir.              E-W
Scale Factor      {scale}
Memo.
{rows}
"""
ROWS = "\n".join(8 * f"{count:9d}" for count in range(1, 26))  # two seconds


def _motion(path: Path, **keys: object) -> RecordedMotion:
    return RecordedMotion(axis="x", file=str(path), **keys)  # type: ignore[arg-type]


def _read(path: Path, content: str | bytes, **keys: object) -> GroundRecord:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if path.suffix in (".csv", ".mcap"):
        keys = {"quantity": "acceleration"} | keys
    return read_record(_motion(path, **keys))


def _refused(path: Path, content: str | bytes, words: str, **keys: object) -> None:
    with pytest.raises(ScenarioError, match=words) as caught:
        _read(path, content, **keys)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(path))


def _peer(*, units: str = "G", count: str = "4", step: str = ".5 SEC") -> str:
    return (
        "PEER STRONG MOTION DATABASE RECORD\nSynthetic\n"
        f"ACCELERATION TIME SERIES IN UNITS OF {units}\nNPTS= {count}, DT= {step}\n"
    )


def _knet(
    *,
    rate: str = "100Hz",
    lasts: str = "2",
    scale: str = "3920(gal)/1960",
    more: str = "",
    rows: str = ROWS,
) -> str:
    return KNET.format(rate=rate, lasts=lasts, scale=scale, more=more, rows=rows)


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


HEADING = "Time [s],Ax [m/s^2],Ay [m/s^2]\n"
COMMAS = "0,1,-1\n1,2,-2\n2,3,-3\n3,4,-4\n"


@pytest.mark.parametrize(
    ("text", "column", "values"),
    [
        (HEADING + COMMAS, "Ax", [1, 2, 3, 4]),
        (HEADING + COMMAS, "Ay [m/s^2]", [-1, -2, -3, -4]),
        ('"Time, s";"A x (m/s2)"\n0,0;0,5\n0,1;1\n0,2;1,5\n0,3;2\n', "A x", None),
        ("t\ta\n0,0\t0,5\n0,1\t1\n0,2\t1,5\n0,3\t2\n", "a", None),
        ("Time [s]  A [g]\n0 0.5\n 1   1.0\n2\t1.5 \n3 2\n", "A", None),
        ("# by hand\n# t, a, b\n" + COMMAS, "b", [-1, -2, -3, -4]),
        ("# t b a\n0 1 .5\n1 2 1\n2 3 1.5D0\n3 4 2\n", "a", None),
        ("# by hand\nt,a,b\n0,.5,\n1,1,2\n2,1.5,\n3,2,\n", "a", None),
        ("0;0,5;\n1;1;\n2;1,5;\n3;2;\n", "", None),
        ("0, 0.5,\n1, 1.0,\n2, 1.5,\n\n3, 2.0,\n", "", None),
        (",t,a\n0,0,.5\n1,1,1\n2,2,1.5\n3,3,2\n", "a", None),
        ("seconds,t_x\n0,.5\n1,1\n2,1.5\n3,2\n", "", None),
        ("n;time_s;a\n0;0;,5\n1;1;1\n2;2;1,5\n3;3;2\n", "", None),
        ('# "remark\n0.5,0.5\r\n1,1\r\n1.5,1.5\r\n2,2\r\n', "", None),
    ],
)
def test_columns_are_those_the_heading_names(
    tmp_path: Path, text: str, column: str, values: list[float] | None
) -> None:
    record = _read(tmp_path / "a.csv", text, column=column)
    assert record.values.tolist() == (values or [0.5, 1.0, 1.5, 2.0])


@pytest.mark.parametrize(
    ("heading", "per_second", "units"),
    [
        ("t [ms],a [g]", 1e-3, "g"),
        ("time_ms,a (cm/s^2)", 1e-3, "cm/s2"),
        ('"Time, us","a [m/s²]"', 1e-6, "m/s2"),
        ("# Time (s) a [mm/s/s]", 1.0, "mm/s2"),
        ("t_rel,a_m_s2", 1.0, None),
        ("Time ms,a", 1e-3, None),
        ("timeMs,a", 1e-3, None),
        ("Milliseconds,a m/s^2", 1e-3, None),
        ("Time (seconds),a", 1.0, None),
        ("t_rel,a_rel", 1.0, None),
        ("t,a []", 1.0, None),
    ],
)
def test_units_that_a_heading_states_are_those_of_the_record(
    tmp_path: Path, heading: str, per_second: float, units: str | None
) -> None:
    between = " " if heading.startswith("#") else ","
    rows = "".join(f"{at}{between}{at * at}\n" for at in range(4))
    record = _read(tmp_path / "a.csv", f"{heading}\n{rows}")
    assert record.times.tolist() == [per_second * at for at in range(4)]
    assert record.units == units


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        (",a,b", "does not tell which column has the times"),
        ("n,t,time", "does not tell which column has the times"),
        ("t,acc_g", r"units: missing, .*'acc_g' .* in g or"),
        ('t,"a, cm_s2"', r"units: missing, .* in cm/s2"),
        ("t,acc g", r"units: missing, .*'acc g' .* in g or"),
        ("t,acc-cm/s^2", r"units: missing, .* in cm/s2"),
        ("t,g", r"units: missing, .*'g' .* in g or"),
        ("t,accG", r"units: missing, .* in g or"),
        ("time_min,a", "times are in 'min', .* expected s, ms"),
    ],
)
def test_a_heading_that_may_mean_two_things_is_refused(
    tmp_path: Path, heading: str, words: str
) -> None:
    rows = "".join(f"{at},{at * at},1\n" for at in range(4))
    if heading.count(",") == 1 or '"' in heading:
        rows = rows.replace(",1\n", "\n")
    _refused(tmp_path / "a.csv", f"{heading}\n{rows}", words)
    if "units" in words:
        assert (
            _read(tmp_path / "a.csv", f"{heading}\n{rows}", units="m/s2").units is None
        )


def test_units_that_nobody_knows_are_refused(tmp_path: Path) -> None:
    _refused(tmp_path / "a.csv", "t [days],a\n0,1\n", r"'days', .* expected s, ms")
    path = tmp_path / "b.csv"
    path.write_text("t,a [mg]\n0,1\n1,2\n2,4\n3,8\n")
    with pytest.raises(ScenarioError, match=r"'mg', expected one of .* overrides"):
        recorded_track(_motion(path, quantity="acceleration"))


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        (
            HEADING + "0,1,2\n0.50,,9\n",
            "Ax",
            r"line 3: Ax .* is nothing, expected a nu",
        ),
        (HEADING + "0,1,2\n1,2,3\n2,3,\n", "Ay", r"line 4: Ay .* is nothing"),
        (HEADING + "0,1,2\n1,2\n", "Ay", r"line 3: Ay .* is nothing"),
        (HEADING + "0,1,2\n,2,3\n", "Ay", r"line 3: time \[s\] is nothing"),
        ("t,a\n0,01,0,5\n", "a", "line 2: has 4 cells, expected 2; decimal commas"),
        ("0,1\n1,1_0\n", "", "line 2: column 2 is '1_0', expected a number"),
        ("0,1\n1,2\n2,3\n3.0", "", "line 4: column 2 is nothing, expected a number"),
        ("0,1\n1,NaN\n", "", "line 2: column 2 is 'NaN'"),
        (f"0,1\n1,{400 * '1'}\n", "", "line 2: column 2 is '1*[.]{3}'"),
        ("0;0,5\n1;1.5\n", "", "'1.5', expected a number with a decimal comma"),
        ('t,a\n0,1\n"1,2\n', "", "line 3: cannot be read as columns"),
        ("t [s],a [x],a [y]\n0,1,2\n", "a", r"names 2 such columns: t \[s\], a"),
        ("Time in s a b\n0 1 2\n", "a", "names no columns"),
        (COMMAS, "a", "names no columns"),
        ((HEADING + COMMAS).encode("utf-16"), "", "UTF-16 .* save it anew"),
        ((HEADING + COMMAS).encode("utf-16-le"), "", "UTF-16 .* save it anew"),
        (" \n", "", "is empty"),
    ],
)
def test_a_text_says_where_it_is_no_record(
    tmp_path: Path, text: str | bytes, column: str, words: str
) -> None:
    _refused(tmp_path / "a.csv", text, words, column=column)


@pytest.mark.parametrize(
    ("units", "understood"),
    [
        ("G", "g"),
        ("G.", "g"),
        ("(G)", "g"),
        ("g's, HORIZONTAL", "g"),
        ("GALS", "gal"),
        ("CM/SEC/SEC", "cm/s2"),
        ("CM/SEC2", "cm/s2"),
        ("CM/S/S", "cm/s2"),
        ("M/SEC**2", "m/s2"),
        ("M / SEC^2", "m/s2"),
        ("CM/SEC", "cm/s"),
    ],
)
def test_peers_many_ways_to_write_a_unit(
    tmp_path: Path, units: str, understood: str
) -> None:
    record = _read(tmp_path / "a.AT2", _peer(units=units) + "1 2 3 4")
    assert record.units == understood


@pytest.mark.parametrize(
    ("words", "understood"),
    [
        ("IN UNITS: CM/S2", "cm/s2"),
        ("UNITS = M/S/S", "m/s2"),
        ("IN CM/SEC/SEC", "cm/s2"),
        ("(GAL)", "gal"),
        ("HISTORY", "g"),
    ],
)
def test_peers_unit_counts_wherever_the_heading_has_it(
    tmp_path: Path, words: str, understood: str
) -> None:
    text = _peer().replace("IN UNITS OF G", words) + "1 2 3 4"
    assert _read(tmp_path / "a.AT2", text).units == understood


@pytest.mark.parametrize(
    ("step", "step_s"),
    [(".5 SEC", 0.5), ("1.0D-2", 0.01), ("10 MSEC", 0.01), ("0.01SEC,", 0.01)],
)
def test_peers_step_and_touching_fields(
    tmp_path: Path, step: str, step_s: float
) -> None:
    body = "-1.234E-01-5.678E-02\n 1.0D-2\n.5-.25"
    head = _peer(step=step, count="5")
    turned = re.sub(r"(NPTS=.*?), (DT=.*)", r"\2, \1", head)
    for text in (head + body, turned + body):
        record = _read(tmp_path / "a.AT2", text)
        assert record.values.tolist() == [-0.1234, -0.05678, 0.01, 0.5, -0.25]
        assert record.times[1] == pytest.approx(step_s)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (_peer(step="..05") + "1 2 3 4", "DT is '..05', expected a number above 0"),
        (_peer(step="1.2.3") + "1 2 3 4", "DT is '1.2.3'"),
        (_peer(step="0") + "1 2 3 4", "DT is '0', expected a number above 0"),
        (_peer(step="1 HOURS") + "1 2 3 4", "DT is '1 HOURS', expected seconds"),
        (_peer(count=5000 * "9") + "1 2 3 4", "NPTS is '9*[.]{3}', expected a number"),
        (_peer(count="5") + "1 2 3 4", "holds 4 values and its heading says 5"),
        (_peer() + "1 2 3\n4 5 6\n7", "holds 7 values and its heading says 4"),
        (_peer() + "1 2\n3 1.5-101", "line 6: a value is '1.5-101'"),
        ("nothing\nof\nthe\nkind\n1 2", "do not say NPTS"),
    ],
)
def test_peer_refused(tmp_path: Path, text: str, words: str) -> None:
    _refused(tmp_path / "a.AT2", text, words)


def test_units_of_the_scenario_override_those_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.AT2"
    path.write_text(_peer(units="FURLONGS", step=".01") + "0 1 -1 0")
    with pytest.raises(ScenarioError, match=r"furlongs.*a.AT2 says.*overrides"):
        recorded_track(_motion(path))
    assert recorded_track(_motion(path, units="cm/s2", drift_hz=0.0)) is not None


NUMBERS = 25 * "0 1 2 3 0 -1 -2 -3 "


@pytest.mark.parametrize(
    ("text", "gals"),
    [
        (_peer(units="G", step=".01", count="200") + NUMBERS, 100.0 * STANDARD_GRAVITY),
        (_peer(units="M/SEC2", step=".01", count="200") + NUMBERS, 100.0),
        (_knet(scale="2(gal)/4", rows=NUMBERS), 0.5),
    ],
)
def test_ground_moves_in_the_units_of_its_record(
    tmp_path: Path, text: str, gals: float
) -> None:
    positions = []
    for content in (text, _peer(units="GAL", step=".01", count="200") + NUMBERS):
        path = tmp_path / ("a.EW" if content.startswith("Origin") else "a.AT2")
        path.write_text(content)
        positions.append(recorded_track(_motion(path, drift_hz=0.0)).position)
    np.testing.assert_allclose(positions[0], gals * positions[1], atol=1e-9)


@pytest.mark.parametrize("before", ["", "\ufeff", "\n", "\ufeff \r\n"])
@pytest.mark.parametrize("more", ["", "Lat. 1\nLong. 2\n"])
def test_knet_is_told_by_its_content(tmp_path: Path, before: str, more: str) -> None:
    record = _read(tmp_path / "a.EW", before + _knet(more=more))
    assert record.values[:9].tolist() == [2.0] * 8 + [4.0]
    assert len(record.times) == 200
    assert record.times[-1] == pytest.approx(1.99)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"rate": "..Hz"}, "Sampling Freq.* is '..', expected a number above 0"),
        ({"scale": "..(gal)/6182761"}, "Scale Factor is '..'"),
        ({"scale": "1.2.3(gal)/6182761"}, "Scale Factor is '1.2.3'"),
        ({"scale": "3920(gal)/0"}, "Scale Factor is '0', expected a number above 0"),
        ({"lasts": "3"}, "holds 200 values and its heading says 300; it was cut"),
        ({"lasts": "1"}, "holds 200 values and its heading says 100; one of the two"),
        ({"rows": "1 x 2"}, "line 7: a value is 'x'"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_knet_refused(tmp_path: Path, keys: dict[str, str], words: str) -> None:
    _refused(tmp_path / "a.EW", _knet(**keys), words)


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
        record = _read(tmp_path / "a.mcap", content, channel="/imu", field="a.1")
        assert record.times == pytest.approx([0.0, 0.01, 0.02, 0.03])
        assert record.values.tolist() == [0.0, 1.0, 2.0, 3.0]


GOOD = [b'{"a": 1}'] * 50


@pytest.mark.parametrize("index_types", [IndexType.ALL, IndexType.NONE])
def test_mcap_without_channels_in_its_summary(
    tmp_path: Path, index_types: IndexType
) -> None:
    messages = [json.dumps({"a": value}).encode() for value in (0.5, 1.0, 1.5, 2.0)]
    content = _mcap(messages, repeat_channels=False, index_types=index_types)
    record = _read(tmp_path / "a.mcap", content, channel="imu", field="a")
    assert record.values.tolist() == [0.5, 1.0, 1.5, 2.0]
    _refused(tmp_path / "a.mcap", content, "it has /imu", channel="ft", field="a")
    with pytest.raises(ScenarioError, match="no 'b'"):
        _read(tmp_path / "a.mcap", content, channel="imu", field="b.0")


def test_a_channel_needs_no_slash(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    slashed, plain = (
        _read(path, _mcap(GOOD), channel=name, field="a") for name in ("/imu", "imu")
    )
    np.testing.assert_array_equal(slashed.values, plain.values)


@pytest.mark.parametrize(("period_ns", "interval_s"), [(10**6, 0.05), (None, 0.07)])
def test_times_are_simulated_ones_where_stamps_tell_how_fast_a_machine_was(
    tmp_path: Path, period_ns: int | None, interval_s: float
) -> None:
    stamped = [b'{"a": 1, "stamp_ns": %d}' % (7 * 10**7 * i) for i in range(1, 50)]
    content = _mcap(stamped, times=LogTimes(period_ns).meaning)
    record = _read(tmp_path / "a.mcap", content, channel="imu", field="a")
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
    _refused(tmp_path / "a.mcap", content, words, channel="/imu", field="a")


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
            _read(tmp_path / "a.mcap", bytes(content), channel="/imu", field="a")
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
        _read(tmp_path / "a.mcap", content, channel="/imu", field="a")
    assert caught.value.field == key


TENTHS = [0.1 * index for index in range(100)]


@pytest.mark.parametrize(
    ("times", "keys", "key", "words"),
    [
        ([1e5 * t for t in TENTHS], {}, "file", "at most 3600; .* in seconds"),
        ([1e9 * t for t in TENTHS], {}, "file", "at most 3600; .* in seconds"),
        (TENTHS, {"drift_hz": 5.0}, "drift_hz", "got 5, .* less than 5 Hz, half"),
        (TENTHS, {"drift_hz": 600.0}, "drift_hz", "less than 5 Hz, half"),
        (TENTHS, {"drift_hz": 1e-9}, "drift_hz", "got 1e-09, expected 0 .* from 0.001"),
        (TENTHS, {"from_s": 100.0}, "from_s", "got 100 s, but .* ends after 9.9 s"),
        (TENTHS[:50] + TENTHS[60:], {}, "file", "from 4.9 s to 6 s, expected one abo"),
        (
            TENTHS + [10.0 + index / 4000.0 for index in range(40)],
            {},
            "file",
            "has 4000 samples a second at 10",
        ),
    ],
)
@pytest.mark.filterwarnings("error")
def test_times_no_ground_can_follow(
    tmp_path: Path, times: list[float], keys: dict[str, float], key: str, words: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{time!r},0.1\n" for time in times))
    with pytest.raises(ScenarioError, match=words) as caught:
        recorded_track(_motion(path, quantity="velocity", **keys))
    assert caught.value.field == key


def test_a_piece_beside_a_gap_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"{t!r},{t!r}\n" for t in TENTHS[:50] + TENTHS[60:]))
    track = recorded_track(_motion(path, quantity="position", to_s=4.0))
    assert len(track.position) == 4001


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_what_is_fast_is_not_weakened(tmp_path: Path, quantity: str) -> None:
    times = np.arange(501) / 50.0
    wave = np.sin(math.tau * 10.0 * times)
    path = tmp_path / "a.csv"
    path.write_text(
        "".join(f"{t:.9f},{v:.9f}\n" for t, v in zip(times, wave, strict=True))
    )
    track = recorded_track(_motion(path, quantity=quantity, drift_hz=0.0))
    middle = getattr(track, quantity)[2000:8000]
    assert math.sqrt(2.0) * middle.std() == pytest.approx(1.0, abs=0.03)
