"""Output folders: foreign files are not touched, and no run is lost."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest

import surefoot as sf
from surefoot.measure import check_out
from surefoot.out_folder import (
    FolderLock,
    OutFolder,
    check_replaceable,
    json_bytes,
    new_file,
)
from surefoot.playback.timeline import read_timeline
from surefoot.recording.write import claim_file
from surefoot.report.run_data import load_runs
from surefoot.run_folder import MARKER, RUN_FILES, TICKS, run_folder, settle_run
from surefoot.run_plan import make_plan
from surefoot.runs import execute
from surefoot.schemas.reasons import Outcome
from surefoot.signals import holds_signals
from tests.command import command, environment, scenario_file
from tests.patient_robot import patient_robot_file
from tests.support import ticks_on_disk, wait_until


def former_run(out: Path) -> None:
    with run_folder(out) as folder:
        for name in (MARKER, "result.json", "robot.log", "ticks.mcap"):
            (folder.path / name).write_text("former")


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_former_run_is_replaced_only_on_request_and_nothing_else(
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    former_run(out)
    (out / "notes.md").write_text("mine")
    (out / "report").mkdir()
    (out / "report" / "index.html").write_text("page")
    with pytest.raises(sf.UsageError, match="--overwrite"), run_folder(out):
        pass
    assert (out / "result.json").read_text() == "former"
    with run_folder(out, overwrite=True) as folder:
        (folder.path / MARKER).write_text("new")
    assert names(out) == {MARKER, "notes.md", "report"}
    assert (out / "notes.md").read_text() == "mine"
    assert (out / "report" / "index.html").read_text() == "page"


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_that_is_no_run_is_refused(tmp_path: Path, overwrite: bool) -> None:
    (tmp_path / "settings.toml").write_text("mine")
    with (
        pytest.raises(sf.UsageError, match="holds other files"),
        run_folder(tmp_path, overwrite=overwrite),
    ):
        pass
    assert (tmp_path / "settings.toml").read_text() == "mine"


def test_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with run_folder(out) as first:
        with pytest.raises(sf.UsageError, match="is writing there now"):
            run_folder(out).__enter__()
        (first.path / MARKER).write_text("first")
    with run_folder(out, overwrite=True):
        pass


def test_names_that_are_no_plain_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, link, real = tmp_path / "file", tmp_path / "link", tmp_path / "real"
    file.write_text("mine")
    real.mkdir()
    link.symlink_to(real)
    (tmp_path / "broken").symlink_to(tmp_path / "nothing")
    for bad in (file, file / "run", tmp_path / "broken"):
        with pytest.raises(sf.UsageError, match="--out"), run_folder(bad):
            pass
    former_run(link)
    assert MARKER in names(real)
    assert link.is_symlink()
    empty = tmp_path / "empty"
    empty.mkdir()
    monkeypatch.chdir(empty)
    former_run(Path())
    assert MARKER in names(empty)
    assert file.read_text() == "mine"


def test_an_error_before_anything_is_worth_keeping_leaves_no_trace(
    tmp_path: Path,
) -> None:
    out = tmp_path / "deep" / "run"
    scenario = sf.Scenario(
        name="x",
        duration_s=1.0,
        push=[sf.Push(body="tail", force_n=(1.0, 0.0, 0.0), start_s=0, duration_s=1)],
    )
    plan = make_plan(scenario)
    with pytest.raises(sf.ScenarioError, match="tail"):
        execute(plan, out=out)
    assert [*tmp_path.iterdir()] == []


def test_a_command_that_is_refused_leaves_the_former_run(tmp_path: Path) -> None:
    out = tmp_path / "run"
    former_run(out)
    before = names(out)
    push = sf.Push(body="tail", force_n=(1.0, 0.0, 0.0), start_s=0, duration_s=1)
    plan = make_plan(sf.Scenario(name="x", duration_s=1.0, push=[push]))
    with pytest.raises(sf.ScenarioError, match="tail"):
        execute(plan, out=out, overwrite=True)
    assert names(out) == before
    assert {path.read_text() for path in out.iterdir()} == {"former"}


KILLED = """
import os, sys
from pathlib import Path
from surefoot.run_folder import MARKER, run_folder
moves, replace = int(sys.argv[2]), Path.replace

def killed(self, target):
    global moves
    if moves == 0:
        os._exit(9)
    moves -= 1
    return replace(self, target)

Path.replace = killed
with run_folder(Path(sys.argv[1]), overwrite=True) as folder:
    (folder.path / MARKER).write_text("new")
    os._exit(9)
"""


@pytest.mark.parametrize("moves", [0, 1, 3, 9], ids="after {} files".format)
def test_what_a_killed_command_set_aside_is_brought_back(
    tmp_path: Path, moves: int
) -> None:
    out = tmp_path / "run"
    former_run(out)
    before = names(out)
    words = [sys.executable, "-c", KILLED, str(out), str(moves)]
    assert subprocess.run(words, check=False).returncode == 9
    assert names(out) != before
    with pytest.raises(sf.UsageError, match="holds a run already"), run_folder(out):
        pass
    assert names(out) == before
    assert {path.read_text() for path in out.iterdir()} == {"former"}


def set_aside(out: Path) -> None:
    """Leave a former run of which a killed command has moved all but the marker."""
    former_run(out)
    aside = out / ".former-x"
    aside.mkdir()
    for name in names(out) - {MARKER, aside.name}:
        (out / name).rename(aside / name)


READERS = {
    "load_run": sf.load_run,
    "read_signals": sf.read_signals,
    "signals of a file": lambda out: sf.read_signals(out / TICKS),
    "replay": read_timeline,
    "report": lambda out: load_runs([out]),
    "log": holds_signals,
}


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_who_reads_a_run_brings_back_what_was_set_aside_and_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, reader: Callable[[Path], object]
) -> None:
    out = tmp_path / "run"
    set_aside(out)
    with suppress(sf.SurefootError):  # what the files say is nonsense
        reader(out)
    assert names(out) == {MARKER, "result.json", "robot.log", "ticks.mcap"}
    assert {path.read_text() for path in out.iterdir()} == {"former"}
    assert "brought back the files that a killed command had set aside" in caplog.text


def test_who_reads_is_told_where_files_are_that_cannot_be_brought_back(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    out = tmp_path / "run"
    set_aside(out)
    lock = FolderLock(out)
    there = names(out)
    settle_run(out)
    assert "not brought back: another command is writing there now" in caplog.text
    lock.release()
    (out / ".former-another").mkdir()
    settle_run(out)
    assert f"{out / '.former-another'}: files that stood in {out}" in caplog.text
    assert "not brought back: there are several such folders" in caplog.text
    assert names(out) == there | {".former-another"}


def test_a_run_is_not_replaced_by_one_that_reads_its_files(tmp_path: Path) -> None:
    ground = tmp_path / "mine.csv"
    ground.write_text("\n".join(f"{0.01 * i},0.0{i % 7}" for i in range(30)))
    scenario = tmp_path / "mine.toml"
    scenario.write_text(
        'name = "mine"\nduration_s = 0.01\n[[platform]]\nfoot = "both"\n'
        '[[platform.motion]]\naxis = "y"\nkind = "recorded"\nfile = "mine.csv"\n'
        'quantity = "position"\nscale = 0.1\n'
    )
    out = tmp_path / "run"
    kept = execute(make_plan(scenario, controller="hold"), out=out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert "ground-0.csv" in before
    attempts = (
        lambda: execute(
            make_plan(out / "scenario.toml", controller="hold"),
            out=tmp_path / "x" / ".." / "run",
            overwrite=True,
        ),
        lambda: sf.load_run(out).save(out, overwrite=True),
        lambda: kept.save(out, overwrite=True),
    )
    (tmp_path / "x").mkdir()
    for attempt in attempts:
        with pytest.raises(sf.UsageError, match="is what this command reads"):
            attempt()
        assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_a_failed_write_that_names_no_file_names_the_folder(tmp_path: Path) -> None:
    with (
        pytest.raises(OSError, match="too large") as caught,
        run_folder(tmp_path / "a"),
    ):
        raise OSError(errno.EFBIG, "File too large")
    assert caught.value.filename == str(tmp_path / "a")


def test_a_folder_without_a_run_is_told_from_a_run_without_ticks(
    tmp_path: Path,
) -> None:
    with pytest.raises(sf.UsageError, match="not the folder of a run"):
        sf.read_signals(tmp_path)
    (tmp_path / MARKER).touch()
    with pytest.raises(sf.UsageError, match="before it kept a tick"):
        sf.read_signals(tmp_path)


def test_without_a_name_nothing_stays() -> None:
    with OutFolder(None, marker=MARKER, content="a run", ours=RUN_FILES) as folder:
        (folder.path / "robot.log").touch()
    assert not folder.path.exists()


def start(folder: Path, *words: str) -> subprocess.Popen[str]:
    scenario = scenario_file(folder, 600.0)
    return subprocess.Popen(
        command(
            "run", scenario, "--controller", "hold", "--out", folder / "run", *words
        ),
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


# By other signals: test_stopping.py; in one process: test_ctrl_c.py.
def test_an_interrupted_run_is_kept_and_says_so(tmp_path: Path) -> None:
    out = tmp_path / "run"
    run = start(tmp_path)
    wait_until(lambda: ticks_on_disk(out) > 1000, what="ticks on the disk")
    run.send_signal(signal.SIGINT)
    told, errors = run.communicate(timeout=120.0)
    assert run.returncode == 130, errors
    assert "interrupted" in told.splitlines()[2]
    loaded = sf.load_run(out)
    assert loaded.outcome is Outcome.INTERRUPTED
    assert loaded.signals.count == loaded.result.ticks > 1000
    assert not loaded.signals.is_cut_off
    assert sf.read_record(out / "run.mcap").is_cut_off is False
    assert {name for name in names(out) if name.endswith(".partial")} == set()


def test_a_killed_run_can_be_read_and_the_next_command_says_how(
    tmp_path: Path,
) -> None:
    out = tmp_path / "run"
    run = start(tmp_path, "--inline")
    wait_until(lambda: ticks_on_disk(out) > 1000, what="ticks on the disk")
    run.kill()
    run.communicate(timeout=60.0)
    with pytest.raises(sf.UsageError, match="surefoot log export"):
        sf.load_run(out)
    signals = sf.read_signals(out)
    assert signals.count > 1000
    assert signals.is_cut_off
    robot = sf.read_signals(out / TICKS)
    still = sf.Scenario(name="still", duration_s=600.0)
    sim = sf.Simulation("walker", still, record=True)
    controller = sf.make_controller("hold", sim.robot)
    while sim.tick < robot.count:
        sim.step(controller)
    for name in robot:
        expected = sim.signals.read(name, 0, robot.count)
        np.testing.assert_array_equal(robot[name], expected)


def test_a_name_that_is_not_unicode(tmp_path: Path) -> None:
    out = Path(os.fsdecode(os.fsencode(tmp_path) + b"/l\xe4ufe"))
    scenario = scenario_file(tmp_path, 0.05)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "surefoot.cli", "run", str(scenario)),
            *("--inline", "--out", os.fsencode(out)),
        ],
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result = msgspec.json.decode((out / "result.json").read_bytes())
    assert "ufe" in result["out"]
    (data,) = load_runs([out])
    assert "ufe" in data.label
    data.label.encode()


def test_json_holds_names_that_are_not_unicode() -> None:
    name = os.fsdecode(b"l\xe4ufe")
    value = {"files": [name, (name, 1.5)], name: None}
    assert msgspec.json.decode(json_bytes(value)) == {
        "files": ["l\ufffdufe", ["l\ufffdufe", 1.5]],
        "l\ufffdufe": None,
    }


def test_a_run_in_memory_is_saved_as_the_command_would(tmp_path: Path) -> None:
    run = sf.simulate("walker", sf.Scenario(name="s", duration_s=0.6), seed=2)
    kept = run.save(tmp_path / "run")
    loaded = sf.load_run(tmp_path / "run")
    assert loaded.result == kept.result
    assert loaded.scenario == run.scenario
    assert list(loaded.signals) == list(run.signals)
    for name in run.signals:
        assert loaded.signals[name].tobytes() == run.signals[name].tobytes()
    with pytest.raises(sf.UsageError, match="--overwrite"):
        run.save(tmp_path / "run")
    run.save(tmp_path / "run", overwrite=True)


def test_a_run_finds_its_robot_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = patient_robot_file(tmp_path)
    monkeypatch.chdir(tmp_path)
    scenario = sf.Scenario(name="s", duration_s=0.01)
    run = sf.simulate(file.name, scenario, controller="hold").save("run")
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert sf.load_run(tmp_path / "run").robot.path == run.robot.path == file.resolve()
    moved = file.rename(file.with_name("moved.toml"))
    for reader in (sf.load_run, READERS["report"]):
        with pytest.raises(sf.UsageError, match=r"put the file back, or write where"):
            reader(tmp_path / "run")
    about = tmp_path / "run" / MARKER
    about.write_text(about.read_text().replace(str(file), str(moved)))
    assert sf.load_run(tmp_path / "run").robot.path == moved


def test_only_a_file_that_says_who_wrote_it_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    check_replaceable(path, signature="by surefoot identify", overwrite=False)
    path.write_text("# Drives of walker, by surefoot identify.\n")
    check_replaceable(path, signature="by surefoot identify", overwrite=True)
    with pytest.raises(sf.UsageError, match="--overwrite"):
        check_replaceable(path, signature="by surefoot identify", overwrite=False)
    path.write_text("# Mine.\n# by surefoot identify\n")
    with pytest.raises(sf.UsageError, match="is left as it is"):
        check_replaceable(path, signature="by surefoot identify", overwrite=True)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder without room")
def test_where_nothing_can_be_written_is_known_before_a_robot_moves() -> None:
    with pytest.raises(sf.EnvironmentFailedError, match=r"--out /proc/x.toml: cannot"):
        check_out(sf.load_robot("walker"), Path("/proc/x.toml"), overwrite=False)


def test_of_two_that_write_one_name_at_once_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    mine = tmp_path / "a.csv.partial"
    mine.write_text("the user's own")
    late = new_file(path, overwrite=False)
    late.__enter__().write(b"second")
    with new_file(path, overwrite=False) as first:
        first.write(b"first")
    with pytest.raises(sf.UsageError, match="another command wrote it meanwhile"):
        late.__exit__(None, None, None)
    assert path.read_text() == "first"
    with new_file(path, overwrite=True) as file:
        file.write(b"third")
    assert path.read_text() == "third"
    assert mine.read_text() == "the user's own"
    assert sorted(tmp_path.iterdir()) == [path, mine]


def test_a_new_file_needs_no_hard_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*names: object) -> None:
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), *names)

    monkeypatch.setattr(os, "link", refuse)  # as on a FAT or a network drive
    path = tmp_path / "a.csv"
    with new_file(path, overwrite=False) as file:
        file.write(b"first")
    with (
        pytest.raises(sf.UsageError, match="another command wrote it meanwhile"),
        new_file(path, overwrite=False) as file,
    ):
        file.write(b"second")
    assert path.read_bytes() == b"first"
    assert [*tmp_path.iterdir()] == [path]


def test_a_record_is_never_replaced_without_asking(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    first = claim_file(path)
    with pytest.raises(sf.UsageError, match="is writing it now"):
        claim_file(path)
    first.write(b"messages")
    first.close()
    with pytest.raises(sf.UsageError, match="was left by a command that was cut off"):
        claim_file(path)
    assert (tmp_path / "a.mcap.partial").read_bytes() == b"messages"
    claim_file(path, overwrite=True).close()
    path.write_bytes(b"whole")
    with pytest.raises(sf.UsageError, match="is there already"):
        claim_file(path)
    assert path.read_bytes() == b"whole"
