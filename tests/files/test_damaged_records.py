"""A damaged or foreign record is read as far as possible, or refused in one line."""

from __future__ import annotations

import contextlib
import resource
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer

from surefoot.errors import ExitCode, exit_code_of
from surefoot.playback.timeline import read_timeline
from surefoot.recording import read
from surefoot.recording.mcap_records import MAGIC
from surefoot.recording.read import RecordError, read_record, record_info
from surefoot.report.run_data import load_run, read_heard
from surefoot.signals import file_sinks
from tests.command import environment
from tests.files.commands import assert_refused_in_one_line, run_here
from tests.files.damage import FOREIGN, KINDS, damaged, foreign_record
from tests.once import short_run
from tests.support import PATIENCE_S, free_port

COPIES = len(KINDS)
MANY_COPIES = 1000
PLAYED_EVERY = 10
"""Only each tenth copy is played, since opening a bus takes longer than reading."""


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of a run's folder, to be damaged."""
    own = tmp_path_factory.mktemp("damaged") / "run"
    return Path(shutil.copytree(short_run(tmp_path_factory), own))


@pytest.fixture(scope="module")
def record(run_folder: Path) -> bytes:
    return (run_folder / "run.mcap").read_bytes()


def read_in_every_way(path: Path, run_folder: Path, *, is_played: bool) -> None:
    """Read a record by each command and by each reader of the library."""
    codes = [run_here("log", "info", path).code]
    for kind, out in (("npz", "a.npz"), ("csv", "c")):
        words = ("--format", kind, "--out", path.parent / out)
        codes.append(run_here("log", "export", path, *words).code)
    codes.append(run_here("replay", "--controller", path).code)
    if is_played:
        listen = f"tcp/127.0.0.1:{free_port()}"
        words = ("--now", "--speed", 1000, "--listen", listen)
        codes.append(run_here("replay", path, *words).code)
    in_run = run_folder / "run.mcap"
    in_run.write_bytes(path.read_bytes())
    with contextlib.suppress(RecordError):
        load_run(run_folder, label="damaged")
    assert set(codes) <= {0, 1, 2}, codes


@pytest.fixture(scope="module")
def ticks(run_folder: Path) -> bytes:
    return (run_folder / "ticks.mcap").read_bytes()


def read_ticks_in_every_way(folder: Path) -> None:
    """Read a run's signals by all their readers."""
    codes = [run_here("log", "info", folder).code]
    codes.append(run_here("log", "info", folder / "ticks.mcap").code)
    for kind, out in (("npz", "a.npz"), ("csv", "c")):
        words = ("--format", kind, "--out", folder.parent / out)
        codes.append(run_here("log", "export", folder, *words).code)
    error = None
    try:
        load_run(folder, label="damaged")
    except Exception as caught:
        error = caught
    assert error is None or exit_code_of(error) is ExitCode.USAGE, repr(error)
    assert set(codes) <= {0, 2}, codes


@pytest.mark.parametrize("count", [4, pytest.param(200, marks=pytest.mark.slow)])
def test_damaged_ticks_are_read_or_refused(
    count: int, ticks: bytes, run_folder: Path
) -> None:
    path = run_folder / "ticks.mcap"
    try:
        for seed in range(count):
            path.write_bytes(damaged(ticks, seed))
            try:
                read_ticks_in_every_way(run_folder)
            except Exception as error:
                raise AssertionError(f"copy {seed}: {error!r}") from error
    finally:
        path.write_bytes(ticks)


@pytest.mark.parametrize(
    "count", [COPIES, pytest.param(MANY_COPIES, marks=pytest.mark.slow)]
)
def test_damaged_copies_are_read_or_refused(
    record: bytes, run_folder: Path, tmp_path: Path, count: int
) -> None:
    path = tmp_path / "damaged.mcap"
    try:
        for seed in range(count):
            path.write_bytes(damaged(record, seed))
            is_played = seed % PLAYED_EVERY == 0
            try:
                read_in_every_way(path, run_folder, is_played=is_played)
            except Exception as error:
                raise AssertionError(f"copy {seed}: {error!r}") from error
    finally:
        (run_folder / "run.mcap").write_bytes(record)


@pytest.mark.parametrize("what", FOREIGN)
def test_records_of_other_programs_are_read_or_refused(
    what: str, run_folder: Path, tmp_path: Path, record: bytes
) -> None:
    path = foreign_record(tmp_path / "other.mcap", what)
    try:
        read_in_every_way(path, run_folder, is_played=True)
    finally:
        (run_folder / "run.mcap").write_bytes(record)
    assert run_here("log", "info", path).code == 0
    refused = run_here("replay", "--controller", path)
    assert_refused_in_one_line(refused, str(path))
    # Names of channels never lead out of the folder they are written to.
    written = {p.name for p in tmp_path.iterdir()}
    assert written <= {"other.mcap", "a.npz", "c"}


@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04 a zip", MAGIC[:3], b"\x00" * 1000]
)
def test_what_is_no_record_is_refused_with_what_it_is(
    content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    for words in (
        ("log", "info", path),
        ("log", "export", path, "--format", "npz", "--out", tmp_path / "a.npz"),
        ("replay", path),
        ("replay", "--controller", path),
    ):
        assert_refused_in_one_line(run_here(*words), str(path))
    for reader in (read_record, read_timeline):
        with pytest.raises(RecordError, match="not an MCAP file"):
            reader(path)
    assert "not an MCAP file" in read_heard(path).gap


def test_a_folder_without_a_record_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.mcap").touch()
    outcome = run_here("replay", tmp_path)
    assert_refused_in_one_line(outcome, "name a file in it (mine.mcap)")


def test_a_run_without_a_record_is_refused_for_that(tmp_path: Path) -> None:
    with file_sinks(tmp_path):
        pass
    outcome = run_here("replay", "--controller", tmp_path)
    assert_refused_in_one_line(outcome, "it holds none of the bus")


def test_a_folder_stands_for_its_record_that_is_cut_off(
    record: bytes, tmp_path: Path
) -> None:
    (tmp_path / "run.mcap.partial").write_bytes(record[: len(record) // 2])
    assert read_timeline(tmp_path).record.is_cut_off


def test_every_prefix_gives_the_messages_it_holds(
    record: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(record)
    whole = read_record(path)
    total = sum(whole.size(name) for name in whole.channels)
    counts = []
    for share in (1, 5, 10, 20, 30, 36, 39):
        path.write_bytes(record[: len(record) * share // 40])
        try:
            cut = read_record(path)
        except RecordError:
            continue
        assert cut.is_cut_off
        counts.append(sum(cut.size(name) for name in cut.channels))
    assert counts == sorted(counts)
    assert 0.8 * total < counts[-1] <= total


@pytest.mark.parametrize("share", [1.0, 0.75])
def test_a_large_record_is_read_again_instead_of_kept(
    record: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(record[: round(share * len(record))])
    kept = read_record(path)
    monkeypatch.setattr(read, "KEPT_BYTES", 1000)
    large = read_record(path)
    assert large._kept is None
    assert record_info(large) == record_info(kept)
    for channel in kept.channels:
        assert large.messages(channel) == kept.messages(channel)


def test_a_damaged_chunk_costs_its_own_messages_alone(
    record: bytes, tmp_path: Path
) -> None:
    """Also when it is the first, which alone describes the channels."""
    path = tmp_path / "a.mcap"
    path.write_bytes(record)
    whole = read_record(path)
    total = sum(whole.size(name) for name in whole.channels)
    chunk = record.index(b"lz4") + 200
    broken = bytearray(record)
    broken[chunk] ^= 0x10
    path.write_bytes(broken)
    damaged = read_record(path)
    assert damaged.channels == whole.channels
    left = sum(damaged.size(name) for name in damaged.channels)
    assert 0 < total - left < total / 2
    assert any("checksum" in str(d) or "chunk" in str(d) for d in damaged.damage)
    assert "damaged" in damaged.condition


def test_a_false_length_does_not_allocate(tmp_path: Path) -> None:
    """In a process of its own that may not have more than a little memory."""
    path = tmp_path / "long.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="")
        writer.finish()
    data = path.read_bytes()
    begin = data[:8]
    files = {
        "record": begin + struct.pack("<BQ", 6, 2**40) + b"x" * 100,
        "chunk": begin
        + struct.pack("<BQ", 6, 60)
        + struct.pack("<QQQIi", 0, 0, 2**40, 0, 4)
        + b"zstd"
        + struct.pack("<Q", 16)
        + b"\x28\xb5\x2f\xfd"
        + bytes(12),
    }
    for name, content in files.items():
        path.write_bytes(content)
        done = subprocess.run(
            [sys.executable, "-m", "surefoot.cli", "log", "info", path],
            env=environment(),
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2**31, 2**31)),
        )
        assert done.returncode == 2, (name, done.stderr)
        assert "Traceback" not in done.stderr
