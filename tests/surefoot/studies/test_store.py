"""Runs are kept, continued, and never mixed."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from surefoot.errors import UsageError
from surefoot.studies import cell, store
from surefoot.studies.cell import Row
from surefoot.studies.store import RUNS, STUDY, StudyStore, read_rows

ABOUT = {"robot": "walker", "set": []}
FIGURES: Row = {
    "outcome": "stood",
    "outcome_detail": "2 s",
    "fell": False,
    "duration_s": 2.0,
    "base_tilt_max_deg": 0.4,
    "contact_lost_s": [0.0, 0.0],
    "contact_gap_s": [0.0, 0.0],
    "qp_failures": 0,
    "log_sha256": "0123",
}
ROWS: list[Row] = [
    {
        **dict.fromkeys(cell.FIGURES),
        **FIGURES,
        **{"key": key, "inputs": "4567", "seed": seed},
        **{"variant": "whole-body", "servo_profile": "ideal"},
    }
    for seed, key in enumerate("ab")
]


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


def test_a_study_that_failed_before_its_first_run_leaves_nothing(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "new" / "study"

    def fail() -> None:
        with StudyStore(folder, about=ABOUT) as store:
            store.begin()
            raise UsageError("no worker answers")

    with pytest.raises(UsageError, match="no worker"):
        fail()
    assert list(tmp_path.iterdir()) == []
    filled(folder)
    kept = list(read_rows(folder))
    with pytest.raises(UsageError, match="no worker"):
        fail()
    assert list(read_rows(folder)) == kept


def test_two_commands_do_not_write_into_one_folder(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    with StudyStore(folder, about=ABOUT) as first:
        first.add(ROWS[0])
        second = StudyStore(folder, about=ABOUT)
        with pytest.raises(UsageError, match="another command is writing there"):
            second.add(ROWS[1])
        first.add(ROWS[1])
    assert list(read_rows(folder)) == ROWS


def test_what_another_command_has_done_since_is_not_done_again(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    looked = StudyStore(folder, about=ABOUT)
    filled(folder)
    with looked:
        looked.begin()
        assert list(looked.rows) == ["a", "b"]


@pytest.mark.parametrize("damage", ["5", "{}", "[]", '{"key": 1}', '{"key": "a", '])
def test_line_that_is_no_run_is_named_and_kept(tmp_path: Path, damage: str) -> None:
    folder = tmp_path / "study"
    filled(folder)
    path = folder / RUNS
    content = path.read_text().replace("\n", f"\n{damage}\n", 1)
    path.write_text(content)
    with pytest.raises(UsageError, match=r"runs.jsonl, line 2: is no finished run"):
        StudyStore(folder, about=ABOUT)
    assert path.read_text() == content


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("inputs", None, "missing required field `inputs`"),
        ("outcome", None, "missing required field `outcome`"),
        ("outcome", "stod", r"'stod' - at `\$.outcome`"),
        ("base_tilt_max_deg", "0,4", r"`float`, got `str` - at `\$.base_tilt_max_deg`"),
        ("force_peak_n", [350.0], r"at `\$.force_peak_n`"),
    ],
)
def test_a_run_edited_by_hand_is_refused_where_it_is_no_run_any_more(
    tmp_path: Path, name: str, value: object, words: str
) -> None:
    folder = tmp_path / "study"
    filled(folder)
    edited = {**ROWS[0], name: value}
    if value is None:
        del edited[name]
    lines = (msgspec.json.encode(row) for row in (edited, ROWS[1]))
    (folder / RUNS).write_bytes(b"\n".join(lines))
    with pytest.raises(UsageError, match=f"line 1: is no finished run.*{words}"):
        StudyStore(folder, about=ABOUT)


def test_a_command_that_comes_too_late_takes_nothing_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "study"
    first, second = (StudyStore(folder, about=ABOUT) for _ in range(2))

    def begin_first(path: Path, *, out: Path) -> None:
        path.mkdir(parents=True, exist_ok=True)
        monkeypatch.undo()
        first.begin()

    with first:
        monkeypatch.setattr(store, "make_out_folder", begin_first)
        with pytest.raises(UsageError, match="another command is writing"), second:
            second.begin()
        first.add(ROWS[0])
    assert list(read_rows(folder)) == ROWS[:1]
    assert (folder / STUDY).is_file()


@pytest.mark.parametrize("damage", ["", "[]", '{"robot": "wal'])
def test_folder_that_does_not_say_its_study_is_refused(
    tmp_path: Path, damage: str
) -> None:
    folder = tmp_path / "study"
    filled(folder)
    (folder / STUDY).write_text(damage)
    with pytest.raises(UsageError, match="does not say what study"):
        StudyStore(folder, about=ABOUT)
