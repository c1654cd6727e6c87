"""How a scenario goes over many seeds: worst and mean of every figure.

    python -m benchmarks.seeds SCENARIO... [--seeds 20] [--jobs 2] [-- RUN OPTIONS]

Each run is ``surefoot run SCENARIO --inline --json``, whose trajectory is that of
lockstep over the bus. Exits with 5 when a robot fell, with 1 when a run failed.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any

FELL = 5
OK_CODES = (0, FELL)
FIGURES = {
    "CoM error rms x [mm]": ("com_error_rms_mm", 0),
    "CoM error rms y [mm]": ("com_error_rms_mm", 1),
    "CoM error rms z [mm]": ("com_error_rms_mm", 2),
    "CoM error max x [mm]": ("com_error_max_mm", 0),
    "CoM error max y [mm]": ("com_error_max_mm", 1),
    "CoM error max z [mm]": ("com_error_max_mm", 2),
    "base tilt max [deg]": ("base_tilt_max_deg", None),
    "force peak left [N]": ("force_peak_n", 0),
    "force peak right [N]": ("force_peak_n", 1),
}


def run_once(scenario: str, seed: int, options: list[str]) -> dict[str, Any]:
    """Return one run's result object.

    Raises:
        RuntimeError: the run failed; holds its last words.
    """
    words = ["run", scenario, "--inline", "--json", "--seed", str(seed), *options]
    done = subprocess.run(
        [sys.executable, "-m", "surefoot.cli", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in OK_CODES:
        raise RuntimeError(
            f"surefoot {' '.join(words)}: exit {done.returncode}\n{done.stderr[-800:]}"
        )
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def table(scenario: str, results: list[dict[str, Any]]) -> str:
    """Return mean and worst of every figure over the seeds."""
    falls = sum(result["fell"] for result in results)
    lines = [f"{scenario}: {len(results)} seeds, {falls} fell"]
    for name, (field, index) in FIGURES.items():
        values = [r[field] if index is None else r[field][index] for r in results]
        mean = sum(values) / len(values)
        lines.append(f"  {name:<22} mean {mean:8.2f}   worst {max(values):8.2f}")
    return "\n".join(lines)


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="+")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    words = sys.argv[1:]
    options: list[str] = []
    if "--" in words:
        cut = words.index("--")
        words, options = words[:cut], words[cut + 1 :]
    arguments = parser.parse_args(words)
    fell = False
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for scenario in arguments.scenarios:
            runs = [
                pool.submit(run_once, scenario, seed, options)
                for seed in range(arguments.seeds)
            ]
            try:
                results = [run.result() for run in runs]
            except RuntimeError as error:
                print(error, file=sys.stderr)
                pool.shutdown(cancel_futures=True)
                return 1
            print(table(scenario, results), flush=True)
            fell = fell or any(result["fell"] for result in results)
    return FELL if fell else 0


if __name__ == "__main__":
    raise SystemExit(main())
