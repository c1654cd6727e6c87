"""Information on and export of records of real runs."""

from __future__ import annotations

import csv
import json
import math
import resource
from pathlib import Path

import msgpack
import numpy as np
import pyarrow.parquet
import pytest
from mcap.writer import Writer

from surefoot.recording.export import export_record, export_signals
from surefoot.recording.read import read_record
from surefoot.recording.write import McapFile
from surefoot.robot_io.client_side.observer import Sample
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.signals import read_signals
from tests.command import Surefoot
from tests.once import short_run
from tests.surefoot.recording.mcap_reading import messages


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run's record, which tests must not change."""
    return short_run(tmp_path_factory) / "run.mcap"


def positions(path: Path) -> np.ndarray:
    return np.array([m.content["q"] for m in messages(path) if m.channel == "joints"])


def test_every_format_gives_back_the_recorded_numbers_bit_for_bit(
    surefoot_here: Surefoot, recorded: Path, tmp_path: Path
) -> None:
    expected = positions(recorded)
    for kind, out in (("npz", "a.npz"), ("csv", "c"), ("parquet", "p")):
        done = surefoot_here(
            "log", "export", recorded, "--format", kind, "--out", tmp_path / out
        )
        assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "a.npz") as arrays:
        np.testing.assert_array_equal(arrays["joints.q"], expected)
        assert set(arrays["status.mode"]) <= {"off", "hold", "active", "fault"}
    names = [f"q.{joint}" for joint in range(expected.shape[1])]
    with (tmp_path / "c" / "joints.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    texts = [[float(row[name]) for name in names] for row in rows]
    np.testing.assert_array_equal(texts, expected)
    table = pyarrow.parquet.read_table(tmp_path / "p" / "joints.parquet")
    columns = [table[name].to_numpy() for name in names]
    np.testing.assert_array_equal(np.stack(columns, axis=1), expected)


@pytest.mark.parametrize("raw", [False, True])
def test_readings_that_are_no_number_leave_numbers_of_the_others(
    tmp_path: Path, raw: bool
) -> None:
    readings = [[1.0, 2.0, 3.0], [math.nan] * 3, [4.0, math.nan, 0.0]]
    with McapFile(
        tmp_path / "a.mcap",
        channels=["left_ankle_ft"],
        keys={"left_ankle_ft": "ft"},
        attachments=[],
        raw=raw,
    ) as file:
        for tick, force in enumerate(readings):
            head = {"schema": SCHEMA_VERSION, "tick": tick, "stamp_ns": tick}
            data = msgpack.packb({**head, "force": force, "moment": force})
            file.add([Sample("left_ankle_ft", data, tick)])
    export_record(read_record(tmp_path / "a.mcap"), "npz", tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        np.testing.assert_array_equal(arrays["left_ankle_ft.force"], readings)
        assert arrays["left_ankle_ft.tick"].dtype == np.int64


def test_an_export_keeps_fields_of_one_name_apart_and_every_digit(
    tmp_path: Path,
) -> None:
    said = {
        "a": [{"b": {"c": 1, "d": 7}, "b.c": 2}] * 2,
        "x.y": [{"z": 3}],
        "x": [{"y.z": 4}],
        "large": [{"v": 2**60 + 1}, {"v": 0.5}],
        "mixed": [{"v": 1}, {"v": "1"}],
    }
    with (tmp_path / "foreign.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="other")
        for name, messages_of_it in said.items():
            number = writer.register_channel(name, "json", schema_id=0)
            for message in messages_of_it:
                writer.add_message(number, 0, json.dumps(message).encode(), 0)
        writer.finish()
    record = read_record(tmp_path / "foreign.mcap")
    export_record(record, "npz", tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        told = {name: array.tolist() for name, array in arrays.items()}
    assert told["x.y.z"] == [3]
    assert told["x.y.z-2"] == [4]
    assert told["large.v"] == [str(2**60 + 1), "0.5"]
    assert told["mixed.v"] == ["1", '"1"']
    export_record(record, "csv", tmp_path / "csv")
    rows = (tmp_path / "csv" / "a.csv").read_text().split()
    assert rows == ["b.c,b.d,b.c-2", "1,7,2", "1,7,2"]
    export_record(record, "parquet", tmp_path / "parquet")
    table = pyarrow.parquet.read_table(tmp_path / "parquet" / "a.parquet")
    assert table.to_pydict() == {"b.c": [1, 1], "b.d": [7, 7], "b.c-2": [2, 2]}


def test_an_export_that_fails_leaves_nothing(recorded: Path, tmp_path: Path) -> None:
    """Files may grow to 20 kB: some tables of the record fit, others do not."""
    present, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, most))
    try:
        with pytest.raises(OSError, match="too large"):
            export_record(read_record(recorded), "csv", tmp_path / "a" / "record")
        with pytest.raises(OSError, match="too large"):
            export_signals(read_signals(recorded.parent), "csv", tmp_path / "signals")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (present, most))
    assert list(tmp_path.iterdir()) == []


def test_info_tells_counts_and_whether_the_file_is_whole(
    surefoot_here: Surefoot, recorded: Path, tmp_path: Path
) -> None:
    told = json.loads(surefoot_here("log", "info", recorded, "--json").stdout)
    counts = {entry["channel"]: entry for entry in told["channels"]}
    assert not told["is_cut_off"]
    assert (counts["joints"]["messages"], counts["joints"]["missing"]) == (300, 0)
    assert "settings.toml" in told["attachments"]
    data = recorded.read_bytes()
    cut = tmp_path / "cut.mcap.partial"
    cut.write_bytes(data[: len(data) // 2])
    done = surefoot_here("log", "info", cut)
    assert done.returncode == 0, done.stderr
    assert "cut off" in done.stdout
    assert "joints" in done.stdout


def test_the_folder_of_a_run_stands_for_its_signals(
    surefoot_here: Surefoot, recorded: Path, tmp_path: Path
) -> None:
    folder = recorded.parent
    signals = read_signals(folder)
    told = json.loads(surefoot_here("log", "info", folder, "--json").stdout)
    assert told["signals"]["q"] == [300, 28]
    assert (told["ticks"], told["lost_ticks"], told["is_cut_off"]) == (300, 0, False)
    shown = surefoot_here("log", "info", folder)
    assert shown.returncode == 0, shown.stderr
    assert signals.describe() in shown.stdout
    for kind, out in (("npz", "a.npz"), ("csv", "c"), ("parquet", "p")):
        words = ["log", "export", folder, "--format", kind, "--out", tmp_path / out]
        done = surefoot_here(*words)
        assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "a.npz") as arrays:
        assert arrays.files == list(signals)
    with (tmp_path / "c" / "ticks.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["tick"]) for row in rows] == list(range(300))
    table = pyarrow.parquet.read_table(tmp_path / "p" / "ticks.parquet")
    assert table.column_names == list(rows[0])
    data = (folder / "ticks.mcap").read_bytes()
    cut_off = tmp_path / "ticks.mcap"
    cut_off.write_bytes(data[: len(data) - 50])
    cut = surefoot_here("log", "info", cut_off)
    assert "cut off" in cut.stdout
    assert "controller_ms" not in cut.stdout


def test_what_is_no_record_is_a_usage_error(
    surefoot_here: Surefoot, tmp_path: Path
) -> None:
    other = tmp_path / "other.mcap"
    other.write_text("something else entirely")
    for path in (other, tmp_path / "absent.mcap"):
        done = surefoot_here("log", "info", path)
        assert done.returncode == 2, done.stderr
        assert str(path) in done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize("form", ["npz", "csv", "parquet"])
@pytest.mark.parametrize("whole_run", [True, False], ids=["signals", "record"])
def test_an_export_replaces_only_an_export(
    surefoot_here: Surefoot, recorded: Path, tmp_path: Path, form: str, whole_run: bool
) -> None:
    source = recorded.parent if whole_run else recorded
    out = tmp_path / ("a.npz" if form == "npz" else "tables")
    words = ("log", "export", source, "--format", form, "--out", out)
    assert surefoot_here(*words).returncode == 0
    again = surefoot_here(*words)
    assert again.returncode == 2
    assert "--overwrite" in again.stderr
    assert surefoot_here(*words, "--overwrite").returncode == 0
    written = sorted(out.iterdir()) if out.is_dir() else [out]
    before = {path: path.read_bytes() for path in written}
    mine = written[-1]
    mine.write_text("my own notes\n")
    refused = surefoot_here(*words, "--overwrite")
    assert refused.returncode == 2
    assert f"{mine}: is there, and not what an export" in refused.stderr
    assert mine.read_text() == "my own notes\n"
    assert all(path.read_bytes() == before[path] for path in written[:-1])
