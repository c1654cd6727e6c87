"""Searches by real workers: killed, continued, and their results."""

from __future__ import annotations

import os
import random
import signal
from contextlib import suppress
from pathlib import Path
from threading import Thread

import msgspec
import pytest

import surefoot as sf
from surefoot.errors import UsageError
from surefoot.run_plan import resolve_settings
from surefoot.studies.cell import Cell
from surefoot.tuning.ask import Sampler
from surefoot.tuning.page import OUTCOME
from surefoot.tuning.trials import PLACE, Trials, evaluate, work
from tests.support import wait_until
from tests.surefoot.tuning.searches import HOLDS, PARAMS, spec_of, still


def kill_workers(journal: Path, places: int, *, kills: int, seed: int) -> list[Path]:
    """Kill workers of a search one by one, after different numbers of trials.

    Returns:
        The lock file of each.
    """
    rng = random.Random(seed)
    folder = journal.with_name(f"{journal.name}.workers")
    wait_until(lambda: journal.is_file() and any(folder.glob("*-*")), what="a worker")
    trials = Trials(journal)
    killed: list[Path] = []
    while len(killed) < kills:
        aim = len(trials.finished()) + rng.randint(0, 2)
        wait_until(lambda aim=aim: len(trials.finished()) >= aim, what="trials")  # type: ignore[misc]
        if len(trials.finished()) > places - 3:
            break
        alive = wait_until(
            lambda: sorted({*folder.glob("*-*")} - {*killed}), what="a worker"
        )
        victim = rng.choice(alive)
        with suppress(ProcessLookupError):
            os.kill(int(victim.name.split("-")[0]), signal.SIGKILL)
        killed.append(victim)
    return killed


def check_kills(
    folder: Path, *, workers: int, places: int, kills: int, sampler: Sampler
) -> None:
    journal = folder / "trials.journal"
    killed: list[Path] = []
    killer = Thread(
        target=lambda: killed.extend(kill_workers(journal, places, kills=kills, seed=1))
    )
    killer.start()
    tuned = sf.tune(
        str(still(folder.parent)),
        PARAMS,
        trials=places,
        workers=workers,
        out=folder,
        controller=HOLDS,
        sampler=sampler,
    )
    killer.join()
    assert len(killed) == kills
    assert [c.place for c in tuned.candidates] == list(range(places))
    finished = Trials(journal).finished()
    assert sorted(t.user_attrs[PLACE] for t in finished) == list(range(places))
    if sampler == "tpe":  # a child of NSGA-II may be its parent again
        assert len({tuple(c.values.values()) for c in tuned.candidates}) == places


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.parametrize("sampler", ["tpe", "nsga2"])
def test_five_killed_workers_lose_no_trial_and_do_none_twice(
    tmp_path: Path, sampler: Sampler
) -> None:
    check_kills(tmp_path / "out", workers=5, places=100, kills=5, sampler=sampler)


def test_trial_ends_with_its_first_fall_and_says_where(tmp_path: Path) -> None:
    scenario = tmp_path / "thrown.toml"
    scenario.write_text(
        'name = "thrown"\nduration_s = 2.0\n[[push]]\nbody = "torso"\n'
        "force_n = [3000.0, 0.0, 0.0]\nstart_s = 0.1\nduration_s = 0.1\n"
    )
    spec = msgspec.structs.replace(spec_of(scenario), seeds=[0, 1, 2])
    trials = Trials(tmp_path / "trials.journal", spec)
    rows, why, down = evaluate(trials, dict(spec.start), [], scheduler=None)
    assert [row["outcome"] for row in rows] == ["fell"]
    assert why == f"{scenario}, seed 0: fell"
    assert down == 1.0


def test_trial_worse_in_every_run_is_given_up_after_a_seed(tmp_path: Path) -> None:
    spec = msgspec.structs.replace(
        spec_of(still(tmp_path)), seeds=[0, 1], objectives=["tilt"]
    )
    trials = Trials(tmp_path / "trials.journal", spec)
    whole, why, _ = evaluate(trials, dict(spec.start), [], scheduler=None)
    assert (len(whole), why) == (2, "")
    better = [row | {"base_tilt_max_deg": 0.0} for row in whole]
    rows, why, down = evaluate(trials, dict(spec.start), [better], scheduler=None)
    assert len(rows) == 1
    assert why.startswith("worse in each run")
    assert down == 0.0, "it stood"
    equal, why, _ = evaluate(trials, dict(spec.start), [whole], scheduler=None)
    assert (len(equal), why) == (2, "")


def test_scenario_that_is_changed_on_the_way_ends_the_search(tmp_path: Path) -> None:
    scenario = still(tmp_path)
    trials = Trials(tmp_path / "trials.journal", spec_of(scenario))

    def change() -> None:
        scenario.write_text(f"{scenario.read_text()}friction = 0.5\n")

    with pytest.raises(UsageError, match=r"still.toml: .* changed since the search"):
        work(trials, count=3, scheduler=None, on_trial=change)
    assert [trial.user_attrs[PLACE] for trial in trials.finished()] == [0]


@pytest.mark.closed_loop
@pytest.mark.process
def test_search_ends_with_settings_page_and_words(tmp_path: Path) -> None:
    scenario = tmp_path / "push.toml"
    scenario.write_text(
        'name = "push"\nduration_s = 1.2\n[[push]]\nbody = "torso"\n'
        "force_n = [60.0, 0.0, 0.0]\nstart_s = 0.9\nduration_s = 0.1\n"
        "[sensors]\nforce_noise_n = 2.0\n"
    )
    out = tmp_path / "out"
    tuned = sf.tune(
        str(scenario),
        {"tsid.com_kp": (5.0, 80.0)},
        trials=2,
        workers=1,
        out=out,
        objectives=["com", "effort"],
        settings={"tsid.com_kp": 6.123456, "dik.com_gain": 3.0},
        held_out_seeds=[7],
    )
    assert all(c.figures[1] > 0.0 for c in tuned.candidates)
    assert tuned.start.values == {"tsid.com_kp": 6.123456}
    read = resolve_settings(out / "settings.toml")
    assert read == tuned.settings
    assert read.dik.com_gain == (3.0, 3.0, 3.0)
    assert read.tsid.com_kp[0] == tuned.chosen.values["tsid.com_kp"]
    (held_out,) = tuned.held_out
    assert (held_out.runs, held_out.up) == (1, (1, 1))
    row = evaluate_once(tuned, scenario, seed=7)
    assert held_out.after is not None
    assert held_out.after[0] == pytest.approx(row)
    page = (out / "index.html").read_text()
    assert "http" not in page.replace("http://www.w3.org", ""), "it opens offline"
    for sentence in tuned.words:
        assert sentence in page
    outcome = msgspec.json.decode((out / OUTCOME).read_bytes())
    assert outcome["chosen"]["place"] == tuned.chosen.place
    assert {p.name for p in (out / "front").iterdir()} == {
        f"trial-{c.place:04d}.toml" for c in tuned.front
    }


def evaluate_once(tuned: sf.Tuned, scenario: Path, *, seed: int) -> float:
    """Return the CoM error of a run with the settings file that was found."""
    (cell,) = tuned.spec.cells([str(scenario)], [seed])
    assert isinstance(cell, Cell)
    run = sf.simulate("walker", scenario, settings=tuned.settings, seed=seed)
    assert run.result.com_error_rms_mm is not None
    return float(sum(x * x for x in run.result.com_error_rms_mm) ** 0.5)
