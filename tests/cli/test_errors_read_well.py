"""Errors of the user and of the machine: one message and the right exit code."""

from __future__ import annotations

import os
import re
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from surefoot.robot_io.errors import TickFileError
from surefoot.robot_io.ticks.read import TickFileTable
from tests.command import Surefoot, scenario_file
from tests.support import free_port

NOTE = re.compile(r"\d\d:\d\d:\d\d INFO ")
STANDING = ["run", "standing", "--controller", "hold", "--inline"]
PRIORITY = ["--realtime-priority", "20"]
MISSPELT_ENDPOINTS = ["--endpoints", 'conect = ["tcp/127.0.0.1:7447"]', "conect"]
PUSH = """name = "push"
duration_s = 0.3
[[push]]
body = "torsoo"
force_n = [0.0, 10.0, 0.0]
start_s = 0.1
duration_s = 0.1
"""
TILT = """name = "tilt"
duration_s = 0.3
[[platform]]
foot = "left"
  [[platform.motion]]
  axis = "roll"
  kind = "sine"
  amplitude_deg = 1.0
  frequency_hz = 1.0
"""


def complaint(done: subprocess.CompletedProcess[str], code: int) -> str:
    """Return the one message of a command that must have failed, without notes.

    The message must begin with our name, without traceback or result beside it.
    """
    assert done.returncode == code, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert "Errno" not in done.stderr
    lines = [line for line in done.stderr.splitlines() if not NOTE.match(line)]
    assert lines[0].startswith("surefoot: ")
    assert sum(line.startswith("surefoot: ") for line in lines) == 1
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            TILT.replace("amplitude_deg", "amplitud_deg"),
            ["platform[0].motion[0].amplitud_deg", "did you mean 'amplitude_deg'?"],
        ),
        (TILT.replace("[[platform]]", "[[platform"), ["not valid TOML", "line 3"]),
        (PUSH, ["push[0].body: got 'torsoo'", "did you mean 'torso'?"]),
        (
            PUSH.replace("torsoo", "torso").replace(
                "duration_s = 0.1", "duration_s = 0.0001"
            ),
            ["push[0].duration_s: got 0.0001 s, expected 0.001 s or more"],
        ),
        (
            'name = "x"\nduration_s = 0.3\n[delay]\nsensor_ms = 1.5\n',
            ["delay.sensor_ms: got 1.5 ms, expected a whole multiple of 1 ms"],
        ),
    ],
)
def test_a_wrong_scenario_is_named_by_file_key_and_value(
    surefoot_here: Surefoot, tmp_path: Path, text: str, words: list[str]
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    out = tmp_path / "out"
    done = surefoot_here("run", path, "--controller", "hold", "--inline", "--out", out)
    told = complaint(done, 2)
    for word in (f"{path}: ", *words):
        assert word in told
    assert not out.exists()


def test_what_only_the_robot_finds_reads_the_same_from_two_processes(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(PUSH)
    told = complaint(surefoot("run", path, "--controller", "hold"), 2)
    assert f"{path}: push[0].body: got 'torsoo'" in told
    assert "INFO" not in told


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([*STANDING, "--set", "tsid.base_kpp=3"], "did you mean 'tsid.base_kp'?"),
        ([*STANDING, "--set", "tsid=3"], "tsid has tsid.com_kp, tsid.com_kd"),
        ([*STANDING, "--set", "xyz=3"], "with sections whole_body, tsid, dik"),
        (
            [*STANDING, "--set", "whole_body.preset=pper"],
            "got 'pper', expected one of 'paper', 'surefoot'",
        ),
        ([*STANDING, "--set", "ground.gain=2"], "got 2, expected a number <= 1.0"),
        (["run", "mine.toml"], "mine.toml: no such scenario file"),
        ([*STANDING, "--robot", "mine.toml"], "mine.toml: no such robot file"),
        ([*STANDING, "--settings", "mine.toml"], "mine.toml: no such file"),
        (["stabilizer", "--endpoints", "mine.toml"], "mine.toml: no such file"),
        (["log", "info", "mine.mcap"], "mine.mcap: No such file"),
        (["run", "dancing"], "no scenario named 'dancing'"),
        (["robot", "dancing"], "moving-platform-slow"),
        (["robot", "mine.toml"], "mine.toml: no such scenario file"),
        ([*STANDING, "--servo-profile", "magic"], "--servo-profile: got 'magic'"),
        ([*STANDING, "--duration", "nan"], "--duration: got nan, expected a finite"),
        (
            [*STANDING, "--duration", "-1"],
            "--duration: got -1.0, expected a number > 0",
        ),
        (
            [*STANDING, "--duration", "1e12"],
            "--duration: got 1000000000000.0, expected",
        ),
        ([*STANDING, "--duration", "1e-9"], "--duration: got 1e-09 s, expected a tick"),
        (
            ["run", "walk-flat-quick", "--inline", "--duration", "0.5"],
            "--duration: walk.start_s: got",
        ),
        ([*STANDING, "--push", "1e15,0,1"], "--push: push[0].force_n[0]: got 1e+16"),
        ([*STANDING, "--push", "1,0,1e5"], "--push: a push at 100000 s: the run ends"),
        (["robot", "--servo-profile", "magic"], "harmonic, ideal"),
        (["run", "standing", "--controller", "magic"], "whole-body"),
        ([*STANDING, "--settings", "zmp-stok"], "zmp-stock, zmp-tuned"),
        ([*STANDING, "--settings", "zmp-tuned"], "read none of its settings"),
        (["margins", "--settings", "zmp-tuned"], "; zmp would. Leave the file out"),
        (["run", "standing", "--connect", "foo"], "cannot dial foo: no protocol"),
        (["run", "standing", "--listen", "foo"], "cannot listen on foo"),
        ([*STANDING, "--realtime"], "--realtime"),
        ([*STANDING, "--overwrite"], "--overwrite needs --out DIR"),
        ([*STANDING, "--listen", "tcp/127.0.0.1:0"], "--listen"),
        ([*STANDING, "--connect", "tcp/a:1"], "--connect"),
        (["run", "standing", *PRIORITY], "goes with --realtime"),
        (["robot", "standing", *PRIORITY], "goes with --realtime"),
        (["stabilizer", *PRIORITY], "goes with --realtime"),
    ],
)
def test_wrong_words_and_missing_files_are_usage_errors(
    surefoot_here: Surefoot, words: list[str], expected: str
) -> None:
    assert expected in complaint(surefoot_here(*words), 2)


@pytest.mark.parametrize(
    ("words", "option", "text", "key"),
    [
        (["run", "standing"], *MISSPELT_ENDPOINTS),
        (["robot"], *MISSPELT_ENDPOINTS),
        (["stabilizer"], *MISSPELT_ENDPOINTS),
        (STANDING, "--settings", "[tsid]\nbase_k = 1.0\n", "tsid.base_k"),
    ],
)
def test_a_wrong_file_is_named_with_its_key(
    surefoot_here: Surefoot,
    tmp_path: Path,
    words: list[str],
    option: str,
    text: str,
    key: str,
) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    told = complaint(surefoot_here(*words, option, path), 2)
    assert f"{path}: {key}: no such key" in told
    assert "did you mean" in told


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize(
    "option",
    ["velocity", "lateral", "yaw-rate", "step-s", "double-s", "height", "wait"],
)
def test_a_walk_by_numbers_that_are_none_is_refused(
    surefoot_here: Surefoot, option: str, value: str
) -> None:
    told = complaint(surefoot_here("walk", f"--{option}={value}"), 2)
    assert f"--{option}: got {value}, expected a finite number" in told


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ["walk", "--velocity=11"],
            "--velocity: got 11, expected a finite number from -10",
        ),
        (
            ["walk", "--steps", "0"],
            "--steps: got 0, expected a whole number of at least 1",
        ),
        (["walk", "--steps", "two"], "--steps: got two, expected a whole number"),
        (
            [*STANDING, "--view-port", "99999"],
            "expected a whole number from 0 to 65535",
        ),
        ([*STANDING, "--out", ""], "--out: is empty; name a folder"),
        ([*STANDING, "--out="], "--out: is empty; name a folder"),
        ([*STANDING, "--settings", " "], "--settings: is empty; name a file"),
        ([*STANDING, "--robot", ""], "--robot: is empty; name a value"),
        (["run", ""], "SCENARIO: is empty"),
        (["sweep", "standing", "", "--out", "x"], "SCENARIOS: is empty"),
        (["report", ""], "RUN_DIR: is empty; name a folder"),
    ],
)
def test_a_value_that_is_empty_or_out_of_range_is_named_by_its_option(
    surefoot_here: Surefoot, words: list[str], expected: str
) -> None:
    assert expected in complaint(surefoot_here(*words), 2)


@pytest.mark.parametrize("command", ["robot", "router", "run"])
def test_a_port_in_use(
    surefoot: Surefoot, surefoot_here: Surefoot, tmp_path: Path, command: str
) -> None:
    out, start = tmp_path / "run", surefoot if command == "run" else surefoot_here
    more = ["standing", "--out", out] if command == "run" else []
    with socket.create_server(("127.0.0.1", 0)) as server:
        locator = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        told = complaint(start(command, *more, "--listen", locator), 3)
    assert f"cannot listen on {locator}: the address is in use" in told
    assert "choose another port" in told
    if command == "run":
        assert "robot: failed with exit code 3" in told
        assert "cannot listen on" in (out / "robot.log").read_text()
        assert not (out / "result.json").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["stabilizer", "--controller", "hold"],
        ["record", "--out", "a.mcap"],
        ["check-robot"],
        ["topics"],
        ["echo", "joints"],
        ["hz"],
        ["relay", "clear", "--listen", "tcp/127.0.0.1:0"],
    ],
    ids=lambda words: words[0],
)
def test_a_robot_that_is_not_there(
    surefoot_here: Surefoot, tmp_path: Path, words: list[str]
) -> None:
    locator = f"tcp/127.0.0.1:{free_port()}"
    told = complaint(surefoot_here(*words, "--connect", locator, "--wait", 0.3), 4)
    assert f"nobody answers at {locator} within 0.3 s" in told
    assert "is the robot running (surefoot robot)" in told
    assert not list((tmp_path / "work").iterdir())


Mount = Callable[[str], Path]


@pytest.fixture
def mount(tmp_path: Path) -> Iterator[Mount]:
    """Mount a small file system, which needs root."""
    mounted: list[Path] = []

    def mount_one(options: str) -> Path:
        place = tmp_path / "disk"
        place.mkdir()
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", options, "surefoot-test", str(place)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            pytest.skip(f"no tmpfs can be mounted here: {done.stderr.strip()}")
        mounted.append(place)
        return place

    if os.name != "posix" or os.geteuid() != 0 or not Path("/bin/mount").exists():
        pytest.skip("only root can mount a small disk; run as root to see this")
    yield mount_one
    for place in mounted:
        subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize(
    "words",
    [STANDING, ["sweep", "standing", "--seeds", "0:1", "--jobs", "1"]],
    ids=lambda words: words[0],
)
def test_an_unwritable_out_folder(
    surefoot_here: Surefoot, mount: Mount, words: list[str]
) -> None:
    place = mount("ro,size=1m")
    told = complaint(surefoot_here(*words, "--out", place / "run"), 3)
    assert f"--out {place / 'run'}: cannot write in " in told
    assert "Read-only file system" in told
    assert "name a folder that can be written to" in told


def test_a_folder_below_a_file_is_a_usage_error(
    surefoot_here: Surefoot, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "run"
    told = complaint(surefoot_here(*STANDING, "--out", out), 2)
    assert f"--out {out}: {tmp_path / 'file'} is not a folder" in told


def test_a_disk_that_fills_up_ends_the_record_and_not_the_run(
    surefoot: Surefoot, mount: Mount, tmp_path: Path
) -> None:
    """64 MiB are left to others, so some of 66 are for the record."""
    out = mount("size=66m") / "run"
    scenario = scenario_file(tmp_path, 1.5)
    done = surefoot("run", scenario, "--controller", "hold", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert "its record is cut off" in done.stderr
    assert "the disk is full but for 64 MiB" in done.stderr
    assert (out / "result.json").exists()
    assert (out / "run.mcap.partial").exists()
    assert not (out / "run.mcap").exists()


@pytest.mark.usual("inline")
@pytest.mark.parametrize("inline", [[], ["--inline"]], ids=["bus", "inline"])
def test_a_disk_too_small_for_the_run_leaves_nothing_that_looks_whole(
    surefoot: Surefoot, mount: Mount, tmp_path: Path, inline: list[str]
) -> None:
    out = mount("size=256k") / "run"
    scenario = scenario_file(tmp_path, 2.0)
    words = ["run", scenario, "--controller", "hold", *inline, "--out", out]
    told = complaint(surefoot(*words), 3)
    assert "No space left on device; make room" in told
    assert "ticks.mcap" in told
    for name in ("result.json", "run.mcap"):
        assert not (out / name).exists()
    for name in ("ticks.mcap", "controller-ticks.mcap"):
        assert not (out / name).exists() or not is_whole(out / name)


def is_whole(path: Path) -> bool:
    """Return whether a ticks file is complete."""
    try:
        return not TickFileTable(path).is_cut_off
    except TickFileError:
        return False
