"""The Pareto front, the choice, and the words about them."""

from __future__ import annotations

import dataclasses
import random
from pathlib import Path

import pytest

import surefoot as sf
from surefoot.out_folder import write_json
from surefoot.tuning.ask import Spec
from surefoot.tuning.outcome import Candidate, Tuned, choose
from surefoot.tuning.page import OUTCOME, as_dict, read_spec
from tests.surefoot.tuning.searches import HOLDS, STILL, spec_of, still


@pytest.fixture
def spec(tmp_path: Path) -> Spec:
    return spec_of(still(tmp_path))


def candidate(
    place: int, *figures: float, stopped: str = "", com_kp: float = 30.0
) -> Candidate:
    values = {"tsid.com_kp": com_kp, "dik.com_gain": 2.0}
    return Candidate(place, values, [], stopped, list(figures))


def test_front_is_what_nothing_beats(spec: Spec) -> None:
    rng = random.Random(3)
    found = [candidate(i, rng.random(), rng.random()) for i in range(50)]
    front, chosen = choose(spec, found)
    for one in front:
        assert not any(
            other.figures[0] < one.figures[0] and other.figures[1] < one.figures[1]
            for other in found
        )
    for other in set(map(id, found)) - set(map(id, front)):
        (beaten,) = (c for c in found if id(c) == other)
        assert any(
            c.figures[0] <= beaten.figures[0] and c.figures[1] <= beaten.figures[1]
            for c in front
        )
    assert chosen in front


def test_choice_is_by_shares_of_the_start_whatever_the_units(spec: Spec) -> None:
    start = candidate(0, 10.0, 1000.0)
    found = [start, candidate(1, 9.0, 1500.0), candidate(2, 11.0, 500.0)]
    assert choose(spec, found)[1].place == 2
    scaled = [candidate(c.place, c.figures[0] * 1e3, c.figures[1]) for c in found]
    assert choose(spec, scaled)[1].place == 2


def test_trial_that_fell_is_never_chosen(spec: Spec) -> None:
    fallen = candidate(1, 0.1, 0.1, stopped="still, seed 0: fell")
    assert choose(spec, [candidate(0, 1.0, 1.0), fallen])[1].place == 0
    start = candidate(0, 0.0, 0.0, stopped="still, seed 0: fell")
    assert choose(spec, [start, candidate(1, 2.0, 2.0)])[1].place == 1
    assert choose(spec, [start]) == ([], start)
    tuned = Tuned(spec, [start], [], start, start, [], [])
    assert "None of 1 trials stood; the start did not: " in tuned.words[0]


def test_words_say_what_changed_with_units(spec: Spec) -> None:
    start, better = candidate(0, 2.0, 2.0), candidate(1, 1.0, 1.0, com_kp=44.0)
    front, chosen = choose(spec, [start, better])
    tuned = Tuned(spec, [start, better], front, start, chosen, [], [])
    assert "tsid.com_kp: 30 to 44 1/s^2 (CoM position gain)." in tuned.words
    assert "tsid.com_kp=44.0" in tuned.overrides


def test_runs_without_noise_are_not_held_out_by_another_seed(tmp_path: Path) -> None:
    noisy = tmp_path / "noisy.toml"
    noisy.write_text(f"{STILL}[sensors]\nforce_noise_n = 2.0\n")
    tuned = sf.tune(
        [still(tmp_path), noisy],
        ["dik.com_gain"],
        trials=1,
        workers=1,
        controller=HOLDS,
        out=tmp_path / "out",
    )
    assert tuned.seen == [str(still(tmp_path))]
    assert [case.case for case in tuned.held_out] == [str(noisy)]
    better = dataclasses.replace(tuned, chosen=candidate(1, 0.5, 0.5))
    assert "No run has a figure for com, force, so nothing" in better.words[-2]
    assert f"Not held out: {still(tmp_path)}." in better.words[-1]
    assert tuned.words[-1] == better.words[-1]


def test_words_say_when_nothing_better_was_found(spec: Spec) -> None:
    start, other = candidate(0, 1.0, 1.0), candidate(1, 2.0, 0.9)
    front, chosen = choose(spec, [start, other])
    tuned = Tuned(spec, [start, other], front, start, chosen, [], [])
    assert "Nothing better than the start" in tuned.words[0]
    assert "on the front" in tuned.words[1]


def test_a_search_does_not_replace_the_outcome_of_another(
    spec: Spec, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    start = candidate(0, 1.0, 1.0)
    write_json(
        out / OUTCOME, as_dict(Tuned(spec, [start], [start], start, start, [], []))
    )
    assert read_spec(out) == spec
    (out / "settings.toml").write_text("[dik]\ncom_gain = 3.0\n")
    for told, words in (
        ((out / OUTCOME).read_text(), r"another search \(differing: parameters, start"),
        ("{}", "does not say of which search it is"),
    ):
        (out / OUTCOME).write_text(told)
        with pytest.raises(sf.UsageError, match=words):
            sf.tune(
                still(tmp_path),
                ["dik.com_gain"],
                controller=HOLDS,
                out=out,
                storage=tmp_path / "trials.journal",
            )
    assert (out / "settings.toml").read_text() == "[dik]\ncom_gain = 3.0\n"
    assert not (tmp_path / "trials.journal").exists()


def test_settings_that_someone_edited_are_kept(tmp_path: Path) -> None:
    out = tmp_path / "out"
    settings, kept = out / "settings.toml", out / "settings-edited-1.toml"

    def search() -> None:
        sf.tune(
            still(tmp_path),
            ["dik.com_gain"],
            trials=1,
            workers=1,
            controller=HOLDS,
            out=out,
        )

    search()
    written, mine = settings.read_text(), "[dik]\ncom_gain = 3.0\n"
    settings.write_text(mine)
    for _ in range(2):
        search()
        assert settings.read_text() == written
        assert kept.read_text() == mine
    assert len(list(out.glob("settings*"))) == 2
