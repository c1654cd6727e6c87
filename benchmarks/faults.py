"""Effect of bus faults on a run: every shipped relay plan on two scenarios.

    python -m benchmarks.faults [--inline] [--seeds 1] [--seconds 10] [--jobs 1]
                                [--plans PLAN...] [--scenarios NAME...] [--out FILE]

Each run is ``surefoot run SCENARIO --realtime --relay PLAN``: robot, relay and
stabilizer are processes on this machine. One run is done at a time: a run that shares
its processors measures the machine. With ``--inline`` the same faults act in simulated
time, where the machine does not matter. Writes a Markdown table.
"""

from __future__ import annotations

import argparse
import itertools
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.started import run_json, shortened
from surefoot.robot_io.relay.relay import list_plans
from surefoot.schemas.reasons import Outcome
from surefoot.signals import read_signals

SCENARIOS = ("standing", "moving-platform-slow")
MRAD = 1e3
ENDED = (0, 1, 5)
"""Exit codes of runs that report an outcome: stood, lost command, fell."""


def run_once(
    scenario: str, plan: str, seed: int, *, mode: str, seconds: float
) -> dict[str, Any]:
    """Return one run's result object and ``step_mrad``, its largest command step.

    Raises:
        RuntimeError: the run gave no result; the message quotes its last lines.
    """
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / f"{scenario}.toml", Path(folder) / "out"
        path.write_text(shortened(scenario, seconds), encoding="utf-8")
        words = (path, f"--{mode}", "--relay", plan, "--seed", seed, "--out", out)
        result = run_json(*words, ended=ENDED)
        steps = np.abs(np.diff(read_signals(out)["q_command"], axis=0))
        result["step_mrad"] = MRAD * float(steps.max(initial=0.0))
        return result


def outcome(result: dict[str, Any]) -> str:
    """Return how a run ended, in the words of its result."""
    said = f"{result['outcome']} {result['outcome_detail']}"
    if result["outcome"] == Outcome.FELL:
        return f"**fell** {result['outcome_detail']}"
    if result["outcome"] != Outcome.STOOD:
        return f"up, {said}"
    lost = ", ".join(f"{name} {why}" for name, why in result["lost_sensors"].items())
    return f"stood, degraded: {lost}" if lost else "stood"


def line(plan: str, scenario: str, results: list[dict[str, Any]]) -> str:
    """Return a line of the table: outcomes and worst figures over the seeds."""
    outcomes = list(dict.fromkeys(outcome(result) for result in results))
    misses = max(r["deadline_misses"] / max(1, r["ticks"]) for r in results)
    errors = [max(r["com_error_max_mm"][i] for r in results) for i in range(3)]
    refused = sorted({name for r in results for name in r["refused"]})
    cells = (
        plan,
        scenario,
        "; ".join(outcomes),
        ", ".join(f"{error:.0f}" for error in errors),
        f"{100 * misses:.0f}",
        f"{max(r['step_mrad'] for r in results):.1f}",
        ", ".join(refused) or "none",
    )
    return f"| {' | '.join(cells)} |"


COLUMNS = (
    "plan",
    "scenario",
    "outcome",
    "CoM error max [mm]",
    "misses [%]",
    "largest step [mrad]",
    "refused",
)
HEAD = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|"


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inline", action="store_true")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--plans", nargs="+", default=list_plans())
    parser.add_argument("--scenarios", nargs="+", default=list(SCENARIOS))
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    mode = "inline" if arguments.inline else "realtime"
    lines = HEAD.splitlines()
    print(HEAD, flush=True)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        cells = {
            (plan, scenario): [
                pool.submit(
                    run_once,
                    scenario,
                    plan,
                    seed,
                    mode=mode,
                    seconds=arguments.seconds,
                )
                for seed in range(arguments.seeds)
            ]
            for plan, scenario in itertools.product(
                arguments.plans, arguments.scenarios
            )
        }
        for (plan, scenario), runs in cells.items():
            lines.append(line(plan, scenario, [run.result() for run in runs]))
            print(lines[-1], flush=True)
    if arguments.out is not None:
        arguments.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
