"""Each trial is finished once and kept, whatever happens to a process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from threading import Thread

import pytest

import surefoot as sf
from surefoot.errors import UsageError
from surefoot.tuning.trials import DOWN, PLACE, ROWS, STOPPED, Trials
from tests.command import environment
from tests.support import PATIENCE_S, wait_until
from tests.surefoot.tuning.searches import HOLDS, PARAMS, spec_of, still

CLAIMS = """
import sys
from pathlib import Path
from surefoot.tuning.trials import Trials
trials = Trials(Path(sys.argv[1]))
with trials.worker() as name:
    trials.claim(name, count=3)
    print("claimed", flush=True)
    sys.stdin.read()
"""
"""A process that takes a trial and never finishes it."""

COUNT = 20
FINISHES = f"""    import os, random, signal, threading, time
    left = int(sys.argv[2])

    def end():
        time.sleep(random.Random(left).uniform(0.0, 0.005))
        os.kill(os.getpid(), signal.SIGKILL)

    while (claimed := trials.claim(name, count={COUNT})) is not None:
        claimed[0].set_user_attr("rows", [])
        claimed[0].set_user_attr("stopped", "")
        trials.study.tell(claimed[0], [1.0, 2.0])
        left -= 1
        if left == 0:
            threading.Thread(target=end).start()
"""
"""A process that finishes all trials left, and kills itself at a random moment.

Trials are empty. It kills itself so that this does not depend on the machine's speed.
"""


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    return tmp_path / "trials.journal"


def begun(journal: Path) -> Trials:
    return Trials(journal, spec_of(still(journal.parent)))


def finish(trials: Trials, count: int = 3) -> dict[int, dict[str, float]]:
    """Finish what is left of a number of trials; return values by place."""
    with trials.worker() as name:
        while (claimed := trials.claim(name, count=count)) is not None:
            trial, _ = claimed
            trial.set_user_attr(ROWS, [])
            trial.set_user_attr(STOPPED, "")
            trial.set_constraint(DOWN, 0.0)
            trials.study.tell(trial, [1.0, 1.0])
    done = trials.finished()
    assert [t.user_attrs[PLACE] for t in done] == list(range(len(done)))
    return {t.user_attrs[PLACE]: dict(t.params) for t in done}


def test_first_trial_is_the_start_and_none_is_drawn_twice(journal: Path) -> None:
    trials = begun(journal)
    values = finish(trials, 5)
    assert values[0] == trials.spec.start
    assert len({tuple(v.values()) for v in values.values()}) == 5


def test_seeds_of_later_places_stay_those_of_a_sampler(tmp_path: Path) -> None:
    spec = spec_of(still(tmp_path), sampler_seed=2**32 - 1)
    spec.make_sampler(1, 0)


def test_search_gone_on_with_is_the_one_that_was_never_ended(journal: Path) -> None:
    finish(begun(journal), 2)
    gone_on = finish(begun(journal), 5)
    other = journal.with_name("other.journal")
    assert finish(begun(other), 5) == gone_on


def test_trial_of_a_killed_process_begins_anew_with_the_same_values(
    journal: Path,
) -> None:
    trials = begun(journal)
    words = [sys.executable, "-c", CLAIMS, str(journal)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(words, env=environment(), **pipes) as taker:  # type: ignore[call-overload]
        assert taker.stdout.readline() == b"claimed\n"
        with trials.worker() as name:
            other = trials.claim(name, count=3)
        assert other is not None
        assert other[0].user_attrs[PLACE] == 1, "that of a living process is left"
        os.kill(taker.pid, signal.SIGKILL)
    values = finish(trials, 14)  # the last ones of which are no longer random
    assert values[0] == trials.spec.start
    assert finish(begun(journal.with_name("other.journal")), 14) == values


def test_search_that_another_command_works_on_is_waited_for(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    journal = out / "trials.journal"
    trials = begun(journal)
    words = [sys.executable, "-c", CLAIMS, str(journal)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(words, env=environment(), **pipes) as taker:  # type: ignore[call-overload]
        assert taker.stdout.readline() == b"claimed\n"
        found: list[sf.Tuned] = []
        search = Thread(
            target=lambda: found.append(
                sf.tune(
                    out / "still.toml",
                    PARAMS,
                    trials=2,
                    workers=1,
                    out=out,
                    controller=HOLDS,
                )
            )
        )
        search.start()
        wait_until(lambda: trials.missing(2) == [0], what="the other trial")
        os.kill(taker.pid, signal.SIGKILL)
        search.join(PATIENCE_S)
    assert [candidate.place for candidate in found[0].candidates] == [0, 1]
    assert found[0].start.values == trials.spec.start


def test_places_beyond_those_asked_for_do_not_count(journal: Path) -> None:
    trials = begun(journal)
    with trials.worker() as name:
        lost, *others = (trials.claim(name, count=3) for _ in range(3))
        for claimed in others:
            assert claimed is not None
            claimed[0].set_user_attr(ROWS, [])
            claimed[0].set_user_attr(STOPPED, "")
            trials.study.tell(claimed[0], [1.0, 2.0])
    assert lost is not None
    assert trials.missing(2) == [0]


def test_half_a_line_is_taken_off_and_nothing_else(journal: Path) -> None:
    trials = begun(journal)
    whole = journal.read_bytes()
    journal.write_bytes(whole + whole.splitlines()[-1][:-7])
    again = Trials(journal)
    assert finish(again).keys() == {0, 1, 2}
    assert journal.read_bytes().startswith(whole)
    assert len(trials.finished()) == 3


def test_other_search_in_the_journal_is_refused_by_what_differs(journal: Path) -> None:
    begun(journal)
    scenario = still(journal.parent)
    with pytest.raises(UsageError, match=r"another search \(differing: seed\)"):
        Trials(journal, spec_of(scenario, sampler_seed=1))
    scenario.write_text(f"{scenario.read_text()}friction = 0.5\n")
    with pytest.raises(UsageError, match=r"\(differing: inputs\)"):
        Trials(journal, spec_of(scenario))


@pytest.mark.parametrize("content", ["years of work", "{}\n", '{"op_code": 0}\n'])
def test_file_that_is_no_journal_is_left_alone(journal: Path, content: str) -> None:
    journal.write_text(content)
    with pytest.raises(UsageError, match="no journal"):
        begun(journal)
    assert journal.read_text() == content


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b'"op_code":5', b'"op_code":', r"line \d+: is damaged"),
        (b'"seeds"', b'"seed"', "another version of surefoot .*`seeds`"),
    ],
)
def test_a_damaged_or_older_journal_is_told_from_a_foreign_file(
    journal: Path, old: bytes, new: bytes, words: str
) -> None:
    finish(begun(journal))
    content = journal.read_bytes()
    assert old in content
    journal.write_bytes(content.replace(old, new, 1))
    with pytest.raises(UsageError, match=words):
        Trials(journal)
    assert journal.read_bytes() == content.replace(old, new, 1)


def test_refused_journal_leaves_nothing_behind(tmp_path: Path, journal: Path) -> None:
    scenario = still(tmp_path)
    journal.write_text("years of work")
    (tmp_path / "folder").mkdir()
    before = sorted(tmp_path.rglob("*"))
    for storage, words in {
        journal: "no journal",
        tmp_path / "folder": "no journal",
        journal / "a.journal": rf"--storage .*{journal.name} is not a folder",
    }.items():
        with pytest.raises(UsageError, match=words):
            sf.tune(
                scenario,
                PARAMS,
                storage=storage,
                out=tmp_path / "new" / "out",
                controller=HOLDS,
            )
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.process
def test_processes_killed_at_any_moment_lose_and_repeat_nothing(journal: Path) -> None:
    """Kills fall into claims and into writes: these workers do nothing else."""
    trials = begun(journal)
    worker = CLAIMS[: CLAIMS.index("    trials.claim")] + FINISHES
    kept: dict[int, object] = {}
    kills = 0
    while len(kept) < COUNT:
        words = [sys.executable, "-c", worker, str(journal), str(1 + kills)]
        ended = subprocess.run(
            words, env=environment(), timeout=PATIENCE_S, check=False
        )
        assert ended.returncode in (0, -signal.SIGKILL)
        kills += ended.returncode != 0
        now = {t.user_attrs[PLACE]: t.datetime_complete for t in trials.finished()}
        assert kept.items() <= now.items()
        kept = dict(now)
    assert sorted(kept) == list(range(COUNT))
    assert len(trials.finished()) == COUNT
    assert kills > 3
