"""One process against two: how fast a whole run goes, in turn.

    python -m benchmarks.bench_run [SCENARIO] [--rounds 3]

Alternates ``surefoot run --inline`` and ``--lockstep`` over Zenoh, so that a machine
whose speed drifts drifts for both, and prints the real-time factor of each run, the
ratio of each pair and the median tick. The trajectories must be equal bit for bit.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from typing import Any


def run_once(scenario: str, mode: str) -> dict[str, Any]:
    """Return one run's result object.

    Raises:
        RuntimeError: the run failed or the robot fell; holds its last words.
    """
    words = [
        sys.executable,
        "-m",
        "surefoot.cli",
        "run",
        scenario,
        f"--{mode}",
        "--json",
    ]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{mode}: exit {done.returncode}\n{done.stderr[-800:]}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="moving-platform-fast")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    ratios = []
    print(f"{'inline':>8}{'lockstep':>10}{'ratio':>8}   tick median inline, lockstep")
    for _ in range(arguments.rounds):
        inline = run_once(arguments.scenario, "inline")
        lockstep = run_once(arguments.scenario, "lockstep")
        if inline["log_sha256"] != lockstep["log_sha256"]:
            print("the two runs differ", file=sys.stderr)
            return 1
        factors = inline["real_time_factor"], lockstep["real_time_factor"]
        ratios.append(factors[1] / factors[0])
        ticks = [result["tick_ms"]["median"] for result in (inline, lockstep)]
        print(
            f"{factors[0]:8.2f}{factors[1]:10.2f}{ratios[-1]:8.2f}"
            f"   {ticks[0]:.3f}, {ticks[1]:.3f} ms",
            flush=True,
        )
    print(f"median ratio {statistics.median(ratios):.2f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
