"""Runs are kept, gone on with, and never mixed."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.errors import UsageError
from surefoot.studies.store import RUNS, StudyStore, read_rows

ABOUT = {"robot": "walker", "set": []}
ROWS = [{"key": "a", "fell": False}, {"key": "b", "fell": True}]


def filled(folder: Path) -> None:
    with StudyStore(folder, about=ABOUT) as store:
        for row in ROWS:
            store.add(row)


def test_finished_runs_are_there_again(tmp_path: Path) -> None:
    filled(tmp_path / "study")
    again = StudyStore(tmp_path / "study", about=ABOUT)
    assert list(again.rows.values()) == ROWS


def test_line_that_was_cut_off_is_left_out_and_others_can_follow(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "study"
    filled(folder)
    path = folder / RUNS
    path.write_bytes(path.read_bytes()[:-6])
    with StudyStore(folder, about=ABOUT) as store:
        assert list(store.rows) == ["a"]
        store.add(ROWS[1])
    assert list(read_rows(folder)) == ROWS


def test_other_settings_are_not_mixed_in(tmp_path: Path) -> None:
    filled(tmp_path / "study")
    with pytest.raises(UsageError, match=r"another study \(differing: set\)"):
        StudyStore(tmp_path / "study", about={"robot": "walker", "set": ["a.b=1"]})


def test_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years")
    with pytest.raises(UsageError, match="no study"):
        StudyStore(tmp_path, about=ABOUT)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
