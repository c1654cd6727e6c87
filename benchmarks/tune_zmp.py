"""Tunes the ZMP baseline on training scenarios, by coordinate search.

    python -m benchmarks.tune_zmp [--jobs 2] [--seeds 1] [--rounds 2] [--out DIR]
                                  [--servo-profile NAME]

Begins at the published values (zmp-stock). First a full grid over the two foot
admittances for both kinds of speed limits, since they belong together; then, round
after round, each setting over its range, the others kept at their best. The training
scenarios are those of benchmarks/training, none of which ships. The servos are those
of the robot's file, or the profile named. A point costs

    1000 x falls + mean over runs of (CoM error / 10 mm + force deviation / 50 N)

with the mean over the axes of the CoM's rms error, and the mean over the feet of the
force's rms deviation. A run that did not stand counts as a fall and nothing else.
Every point tried goes into DIR/points.csv, best first; DIR/best.toml is what
--settings reads.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from surefoot.run_plan import make_plan
from surefoot.runs import run_inline
from surefoot.schemas.toml_file import read_toml
from surefoot.stabilizer.factory import find_settings

TRAINING = sorted((Path(__file__).parent / "training").glob("*.toml"))
START = Path("zmp-stock")
STOCK = read_toml(find_settings(START))["zmp"]
Point = dict[str, Any]
FALL_COST, COM_UNIT_MM, FORCE_UNIT_N = 1000.0, 10.0, 50.0
FIXED: Point = {"friction": 0.6}
"""The same margin to the true friction as the whole-body controller."""
SPEED_LIMITS = [(0.2, 0.1), (3.0, 1.0)]
GRID = {
    "cop_admittance": [0.01, 0.02, 0.04, 0.07, 0.1],
    "dfz_admittance": [1e-4, 2e-4, 3.5e-4, 5e-4],
}
RANGES: dict[str, list[Any]] = {
    "level_base": [0.0, 1.0],
    "level_height": [0.0, 1.0],
    "com_weight": [1e3, 1e4, 1e5],
    "contact_damping": [150.0, 300.0],
    "dcm_prop_gain": [1.0, 2.0, 3.0, 4.0, 5.0],
    "dcm_integral_gain": [5.0, 10.0, 15.0, 20.0],
    "dcm_deriv_gain": [0.0, 0.25, 0.5],
    "dcm_bias": ["off", "bias", "filter"],
    "com_admittance": [0.0, 0.1, 0.25, 0.5],
    "dfz_damping": [0.0, 0.5],
    "vdc_frequency": [0.5, 1.0, 2.0],
    "cop_admittance": [0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.085, 0.1],
    "dfz_admittance": [5e-5, 1e-4, 2e-4, 3e-4, 4e-4, 5e-4],
}


def run_once(
    point: Point, scenario: str, seed: int, servo_profile: str | None
) -> tuple[bool, float, float]:
    """Return one training run: did not stand, CoM error [mm], force deviation [N]."""
    plan = make_plan(
        scenario,
        robot="walker",
        servo_profile=servo_profile,
        controller="zmp",
        settings=START,
        overrides=[f"zmp.{name}={value}" for name, value in point.items()],
        seed=seed,
        mode="inline",
    )
    result = run_inline(plan).result
    com = sum(result.com_error_rms_mm) / 3.0
    is_down = not result.outcome.is_up
    return is_down, com, sum(result.force_deviation_rms_n) / 2.0


class Search:
    """Evaluates points, each once, and keeps what came out.

    Attributes:
        rows: one per point tried.
    """

    def __init__(
        self, pool: ProcessPoolExecutor, *, seeds: int, servo_profile: str | None
    ) -> None:
        """Begin with no points."""
        self._pool = pool
        self._seeds = seeds
        self._servo_profile = servo_profile
        self.rows: list[Point] = []

    def best_of(self, points: list[Point]) -> Point:
        """Return the cheapest of some points; the earlier one when equal."""
        known = {_key(row["point"]) for row in self.rows}
        new = [p for p in points if _key(p) not in known]
        new = list({_key(p): p for p in new}.values())
        jobs = [
            [
                self._pool.submit(
                    run_once, point, str(scenario), seed, self._servo_profile
                )
                for scenario in TRAINING
                for seed in range(self._seeds)
            ]
            for point in new
        ]
        for point, runs in zip(new, jobs, strict=True):
            self.rows.append(_summarise(point, [run.result() for run in runs]))
        costs = {_key(row["point"]): row["cost"] for row in self.rows}
        best = min(points, key=lambda point: costs[_key(point)])
        print(f"{len(self.rows):4d} points, best {costs[_key(best)]:8.3f}  {best}")
        sys.stdout.flush()
        return best


def _summarise(point: Point, runs: list[tuple[bool, float, float]]) -> Point:
    stood = [run for run in runs if not run[0]]
    falls, count = len(runs) - len(stood), max(len(stood), 1)
    com = sum(run[1] for run in stood) / count
    force = sum(run[2] for run in stood) / count
    cost = FALL_COST * falls + com / COM_UNIT_MM + force / FORCE_UNIT_N
    return {"cost": cost, "falls": falls, "com_mm": com, "force_n": force} | {
        "point": point
    }


def _key(point: Point) -> tuple[tuple[str, Any], ...]:
    """Return what makes a point: the settings in which it differs from the start."""
    changed = {k: v for k, v in point.items() if STOCK[k] not in (v, [v, v])}
    return tuple(sorted(changed.items()))


def search(found: Search, *, rounds: int, out: Path) -> None:
    """Search a grid of the foot admittances, then coordinate rounds until no change."""
    # Where the search begins, so that the table shows what tuning brought.
    found.best_of([{}])
    grid = itertools.product(GRID["cop_admittance"], GRID["dfz_admittance"])
    best = found.best_of(
        [
            FIXED
            | {"max_fdc_velocity_rad_s": turn, "max_vertical_velocity_m_s": lift}
            | {"cop_admittance": cop, "dfz_admittance": force}
            for (cop, force), (turn, lift) in itertools.product(grid, SPEED_LIMITS)
        ]
    )
    write(found, out)
    for _ in range(rounds):
        before = best
        for name, values in RANGES.items():
            best = found.best_of([best, *(best | {name: value} for value in values)])
        # What is found so far is kept, should the search be stopped.
        write(found, out)
        if best == before:
            break


def write(found: Search, out: Path) -> None:
    """Write the table of all points and the best as a settings file."""
    rows = sorted(found.rows, key=lambda row: row["cost"])
    names = sorted({name for row in rows for name in row["point"]})
    out.mkdir(parents=True, exist_ok=True)
    with (out / "points.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["cost", "falls", "com_error_mm", "force_deviation_n", *names])
        for row in rows:
            figures = [row["cost"], row["falls"], row["com_mm"], row["force_n"]]
            rounded = [f"{figure:.4g}" for figure in figures]
            table.writerow(rounded + [row["point"].get(name, "") for name in names])
    lines = ["# Best point; what is not named is as in zmp-stock.", "[zmp]"]
    lines += [f"{name} = {json.dumps(v)}" for name, v in rows[0]["point"].items()]
    (out / "best.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> int:
    """Read the command line, search and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--servo-profile")
    parser.add_argument("--out", type=Path, default=Path("out/tune-zmp"))
    arguments = parser.parse_args()
    with ProcessPoolExecutor(arguments.jobs) as pool:
        found = Search(
            pool, seeds=arguments.seeds, servo_profile=arguments.servo_profile
        )
        search(found, rounds=arguments.rounds, out=arguments.out)
    print(f"wrote {arguments.out}/points.csv and best.toml")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
