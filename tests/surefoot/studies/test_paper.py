"""The page about the evaluation, from all runs or from a few."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from surefoot.studies import paper as d
from surefoot.studies.cell import Cell
from surefoot.studies.paper import FAILS, HOLDS, OPEN, Evidence, claims, goals
from surefoot.studies.paper_page import write_report
from surefoot.studies.summaries import summarise

ABOUT = {"code": "0123456789abcdef"}


def row(cell: Cell, *, fell: bool, com_mm: float, force_n: float) -> dict[str, Any]:
    """Return a finished run as the store holds it."""
    group = cell.group
    return {
        "key": cell.key,
        "scenario": group.scenario,
        "values": dict(group.values),
        "variant": group.variant,
        "servo_profile": group.servo_profile,
        "seed": cell.seed,
        "outcome": "fell" if fell else "stood",
        "log_sha256": cell.key,
        "com_error_rms_mm": [com_mm, com_mm, 5.0],
        "com_error_max_mm": [com_mm, com_mm, 9.0],
        "base_tilt_max_deg": 1.0,
        "force_deviation_rms_n": [force_n, force_n],
        "force_peak_n": [400.0, 400.0],
        "contact_gap_s": [0.0, 0.1],
    }


def measured(*, zmp_falls: bool) -> list[dict[str, Any]]:
    """Return every case of the quick study, with whole-body ten times as good."""
    cells = d.cells_of(d.extent(quick=True, seeds=2))
    return [
        row(cell, fell=False, com_mm=1.0, force_n=10.0)
        if cell.group.variant == d.WHOLE_BODY
        else row(cell, fell=zmp_falls, com_mm=10.0, force_n=100.0)
        for cell in cells
    ]


def verdicts(rows: list[dict[str, Any]]) -> dict[str, str]:
    evidence = Evidence(summarise(rows))
    return {f.statement: f.verdict for f in (*claims(evidence), *goals(evidence))}


def test_no_two_runs_of_the_whole_study_are_taken_for_one() -> None:
    cells = d.cells_of(d.extent(quick=False, seeds=None))
    assert len({cell.key for cell in cells}) == len(cells)
    assert {cell.seed for cell in cells} == set(range(d.FULL_SEEDS))


@pytest.mark.parametrize("zmp_falls", [True, False])
def test_claims_are_held_against_what_was_measured(zmp_falls: bool) -> None:
    found = verdicts(measured(zmp_falls=zmp_falls))
    slow = next(v for s, v in found.items() if s.startswith("One platform, slow"))
    fast = next(v for s, v in found.items() if s.startswith("One platform, fast"))
    lower = next(v for s, v in found.items() if s.startswith("Where both survive"))
    assert slow == (FAILS if zmp_falls else HOLDS)
    assert fast == (HOLDS if zmp_falls else FAILS)
    assert lower == (OPEN if zmp_falls else HOLDS)


def test_what_was_not_run_is_said_and_not_made_up() -> None:
    assert set(verdicts([]).values()) == {OPEN}


def test_fall_of_ours_is_no_success() -> None:
    rows = [
        {**r, "outcome": "fell"} if r["variant"] == d.WHOLE_BODY else r
        for r in measured(zmp_falls=False)
    ]
    found = verdicts(rows)
    assert HOLDS not in found.values()


def test_page_needs_no_network_and_names_missing_runs(tmp_path: Path) -> None:
    rows = measured(zmp_falls=False)
    page = write_report(tmp_path, summarise(rows[:40]), about=ABOUT, missing=7)
    text = page.read_text()
    links = re.findall(r'(?:src|href)\s*=\s*"([^"]*)"', text)
    assert links
    assert all(link.startswith("data:image/svg+xml;base64,") for link in links)
    assert "7 runs of this study have not been done" in text
    findings = msgspec.json.decode((tmp_path / "findings.json").read_bytes())
    assert set(findings) == {"claims", "goals"}
    assert (tmp_path / "summary.csv").read_text().count("\n") >= 2


def test_the_limit_is_told_for_both_servos_and_judged_with_the_ideal_one() -> None:
    """With slow servos everything above 60 deg/s falls here."""
    rows = [
        {**r, "outcome": "fell" if is_slow(r) and too_fast(r) else "stood"}
        for r in measured(zmp_falls=False)
    ]
    (limit,) = (
        f
        for f in goals(Evidence(summarise(rows)))
        if f.statement.startswith("Half stay up")
    )
    assert limit.verdict == HOLDS
    assert "ideal roll over 240, pitch over 240, diagonal over 240" in limit.measured
    assert "harmonic roll 90, pitch 90, diagonal 90 deg/s" in limit.measured


def is_slow(run: dict[str, Any]) -> bool:
    return bool(run["servo_profile"] == d.SLOW)


def too_fast(run: dict[str, Any]) -> bool:
    return bool(run["values"].get(d.TILT_RATE, 0.0) > d.PAPER_LIMIT_DEG_S)


def test_a_limit_below_all_that_was_tried_is_no_limit_at_the_lowest() -> None:
    rows = [
        {**r, "outcome": "fell" if r["values"] else "stood"}
        for r in measured(zmp_falls=False)
    ]
    found = goals(Evidence(summarise(rows)))
    (limit,) = (f for f in found if f.statement.startswith("Half stay up"))
    assert limit.verdict == FAILS
    assert "ideal roll under 60, pitch under 60" in limit.measured
