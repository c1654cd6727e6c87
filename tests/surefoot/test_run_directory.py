from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.errors import UsageError
from surefoot.run_folder import MARKER, RunDirectory


def finished_run(out: Path, text: str) -> None:
    with RunDirectory(out) as run:
        (run.path / MARKER).write_text("{}")
        (run.path / "result.json").write_text(text)
        run.keep()


def test_a_run_appears_whole_under_its_name(tmp_path: Path) -> None:
    out = tmp_path / "new" / "run"
    with RunDirectory(out) as run:
        (run.path / MARKER).write_text("{}")
        assert not out.exists()
        run.keep()
    assert [path.name for path in out.iterdir()] == [MARKER]
    assert list(out.parent.iterdir()) == [out]


def test_a_former_run_is_replaced(tmp_path: Path) -> None:
    out = tmp_path / "run"
    finished_run(out, "first")
    (out / "left-over").touch()
    finished_run(out, "second")
    assert (out / "result.json").read_text() == "second"
    assert not (out / "left-over").exists()
    assert list(tmp_path.iterdir()) == [out]


def test_a_run_that_ends_early_leaves_the_former_one(tmp_path: Path) -> None:
    out = tmp_path / "run"
    finished_run(out, "first")
    with RunDirectory(out) as run:
        (run.path / MARKER).write_text("{}")
    assert (out / "result.json").read_text() == "first"
    assert list(tmp_path.iterdir()) == [out]


def test_an_empty_folder_is_used(tmp_path: Path) -> None:
    out = tmp_path / "run"
    out.mkdir()
    finished_run(out, "only")
    assert (out / "result.json").read_text() == "only"


def test_other_files_are_never_touched(tmp_path: Path) -> None:
    precious = tmp_path / "thesis.tex"
    precious.write_text("words")
    with pytest.raises(UsageError, match="holds other files"):
        RunDirectory(tmp_path)
    with pytest.raises(UsageError, match="is a file"):
        RunDirectory(precious)
    with pytest.raises(UsageError, match="is not a folder"):
        RunDirectory(precious / "run")
    assert precious.read_text() == "words"


def test_a_run_without_name_leaves_nothing() -> None:
    with RunDirectory(None) as run:
        (run.path / "robot.log").touch()
        run.keep()
    assert not run.path.exists()
