"""What the loss of an ankle sensor leads to: ``degrade`` against ``hold``.

    python -m benchmarks.lost_sensors [--seeds 1] [--jobs 2] [--out FILE]

Each cell is a run of a shipped scenario, cut short, in one process (``surefoot run
--inline``) with one ``[[fault]]`` more, which lasts until the end. Writes Markdown.
"""

from __future__ import annotations

import argparse
import itertools
import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.started import run_json, shortened
from surefoot.studies.tables import markdown

FELL = 5


class Case(NamedTuple):
    """A scenario, how long it is run, and when the sensor fails [s]."""

    scenario: str
    duration_s: float
    start_s: float


CASES = (
    Case("standing", 9.0, 4.0),
    Case("moving-platform-slow", 12.0, 4.0),
    Case("falling-platform-80", 7.0, 3.0),
)
FAULTS = {
    "missing": 'kind = "drop"',
    "frozen": 'kind = "freeze"',
    "NaN": 'kind = "nan"',
    "jumps by 2500 N": 'kind = "jump"\nsize = 2500.0',
    "biased by 100 N": 'kind = "jump"\nsize = 100.0',
    "biased by 300 N": 'kind = "jump"\nsize = 300.0',
}
SIDES = ("left", "right")
POLICIES = ("degrade", "hold")


def run_once(
    case: Case, fault: str, side: str, policy: str, seed: int, folder: Path
) -> dict[str, Any]:
    """Return one run's result object.

    Raises:
        RuntimeError: the run failed; holds its last words.
    """
    name = f"{case.scenario} {fault} {side} {policy} {seed}".replace(" ", "-")
    path = folder / f"{name}.toml"
    path.write_text(
        shortened(case.scenario, case.duration_s)
        + f'\n[[fault]]\nsensor = "{side}_ankle_ft"\n{FAULTS[fault]}\n'
        + f"start_s = {case.start_s}\nduration_s = 3600.0\n"
    )
    return run_json(
        path,
        *("--inline", "--seed", seed, "--set", f'safety.ft_lost="{policy}"'),
        ended=(0, FELL),
    )


def cell(results: list[dict[str, Any]]) -> str:
    """Return outcome and largest error of runs that differ by their seed only."""
    falls = [r["fell_at_s"] for r in results if r["fell"]]
    if falls:
        share = "" if len(falls) == len(results) else f" {len(falls)} of {len(results)}"
        return f"**fell**{share} at {min(falls):.1f} s"
    x, y, z = (max(r["com_error_max_mm"][i] for r in results) for i in range(3))
    noticed = all(r["degraded_ticks"] for r in results)
    return f"{x:.0f}, {y:.0f}, {z:.0f}" + ("" if noticed else " (unnoticed)")


def table(cells: dict[tuple[str, str, str, str], str]) -> str:
    """Return a Markdown table: a row per fault and side, two columns per scenario."""
    names = [case.scenario for case in CASES]
    heads = [f"{name}, {policy}" for name in names for policy in POLICIES]
    rows = [
        (
            f"{side} {fault}",
            *(cells[name, fault, side, how] for name in names for how in POLICIES),
        )
        for fault, side in itertools.product(FAULTS, SIDES)
    ]
    return markdown(["sensor", *heads], rows)


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    grid = list(itertools.product(CASES, FAULTS, SIDES, POLICIES))
    with (
        tempfile.TemporaryDirectory() as folder,
        ThreadPoolExecutor(arguments.jobs) as pool,
    ):
        runs = {
            (case.scenario, fault, side, policy): [
                pool.submit(run_once, case, fault, side, policy, seed, Path(folder))
                for seed in range(arguments.seeds)
            ]
            for case, fault, side, policy in grid
        }
        cells = {key: cell([run.result() for run in of]) for key, of in runs.items()}
    text = table(cells)
    print(text, end="")
    if arguments.out is not None:
        arguments.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
