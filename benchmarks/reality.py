"""What a robot with sensors and drives as people own them makes of its ground.

    python -m benchmarks.reality [--seeds 1] [--random 4] [--only WORD] [--out FILE]

Each line is one imperfection, or several at once, as the tables of a scenario file, put
into shipped scenarios that are cut short, in one process. Random lines draw from all
imperfections at once; the number of each is its seed. Writes Markdown. A line of your
own is an entry of ``LINES``; what random lines draw from is ``draw``.
"""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.shortened import shortened
from surefoot.runs import simulate
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import scenario_from_table

Tables = dict[str, Any]
GROUND = {"standing": 4.0, "moving-platform-slow": 10.0, "moving-platform-fast": 5.0}
"""Shipped scenarios, and how long each is run [s]."""
SLOW_DRIVES = "harmonic"


class Line(NamedTuple):
    """Imperfections of one robot.

    Attributes:
        name: shown in the table.
        tables: of the scenario, laid over those of the shipped one.
        servo_profile: of the drives; None: the robot file's own.
    """

    name: str
    tables: Tables
    servo_profile: str | None = None


def sensors(**values: Any) -> Tables:
    """Return the tables of one line with sensor errors."""
    return {"sensors": values}


LINES = (
    Line("none", {}),
    Line("accelerometer +0.03 m/s^2", sensors(accel_bias_m_s2=0.03)),
    Line("accelerometer +0.2 m/s^2", sensors(accel_bias_m_s2=0.2)),
    Line("accelerometer 0.3, -0.3, 0.3", sensors(accel_bias_m_s2=[0.3, -0.3, 0.3])),
    Line("gravity 9.76", {"model_error": {"gravity_m_s2": 9.76}}),
    Line("gravity 9.84", {"model_error": {"gravity_m_s2": 9.84}}),
    Line("gyroscope +0.02 rad/s", sensors(gyro_bias_rad_s=0.02)),
    Line("gyroscope 0.05, -0.05, 0.05", sensors(gyro_bias_rad_s=[0.05, -0.05, 0.05])),
    Line("forces +30 N", sensors(force_bias_n=30.0)),
    Line("moments +5 N m", sensors(moment_bias_nm=5.0)),
    Line(
        "payload 3 kg in one hand", {"payload": [{"link": "left_hand", "mass_kg": 3.0}]}
    ),
    Line("starts on moving ground", {"platform": {"start_s": 0.0}}),
)
"""One imperfection each."""


def draw(seed: int, *, payload_link: str) -> Line:
    """Return a robot with all imperfections at once, within what data sheets say.

    Args:
        seed: of the draw.
        payload_link: which link holds the payload.
    """
    rng = np.random.default_rng(seed)

    def within(size: float) -> list[float]:
        return [round(float(x), 5) for x in rng.uniform(-size, size, 3)]

    tables = {
        "sensors": {
            "accel_bias_m_s2": within(0.3),
            "gyro_bias_rad_s": within(0.02),
            "force_bias_n": {"left": within(5.0), "right": within(5.0)},
            "moment_bias_nm": {"left": within(0.5), "right": within(0.5)},
        },
        "model_error": {"gravity_m_s2": round(float(rng.uniform(9.76, 9.84)), 4)},
        "payload": [
            {"link": payload_link, "mass_kg": round(float(rng.uniform(0.5, 3.0)), 3)}
        ],
    }
    drives = SLOW_DRIVES if rng.random() < 0.5 else None
    return Line(f"random {seed}" + (f", {drives}" if drives else ""), tables, drives)


def lay_over(text: str, tables: Tables) -> Tables:
    """Return a scenario's tables with those of a line laid over them.

    Args:
        text: of the scenario file.
        tables: of the line; what is said of ``platform`` goes into every motion.
    """
    raw = tomllib.loads(text)
    for name, values in tables.items():
        if name == "platform":
            for platform in raw.get("platform", []):
                for motion in platform["motion"]:
                    motion.update(values)
        elif isinstance(values, dict):
            raw[name] = {**raw.get(name, {}), **values}
        else:
            raw[name] = values
    return raw


def run_once(line: Line, ground: str, seed: int) -> RunResult:
    """Return one run's result."""
    raw = lay_over(shortened(ground, GROUND[ground]), line.tables)
    scenario = scenario_from_table(raw, source=f"{line.name} on {ground}")
    run = simulate(
        scenario=scenario, seed=seed, servo_profile=line.servo_profile, record=False
    )
    return run.result


def cell(results: list[RunResult]) -> str:
    """Return how many stood, and the largest lasting error of those [mm]."""
    up = [result for result in results if result.outcome == "stood"]
    if not up:
        return f"**{results[0].outcome}**"
    errors = [result.com_error_rms_mm or [np.nan] * 3 for result in up]
    x, y, z = np.max(np.array(errors), axis=0)
    share = "" if len(up) == len(results) else f"{len(up)} of {len(results)}: "
    return f"{share}{x:.1f}, {y:.1f}, {z:.1f}"


def rows(lines: list[Line], seeds: int) -> Iterator[str]:
    """Run everything; a row of the table per line, as soon as it is known."""
    yield f"| imperfection | {' | '.join(GROUND)} |"
    yield "|" + "---|" * (len(GROUND) + 1)
    for line in lines:
        cells = [
            cell([run_once(line, ground, seed) for seed in range(seeds)])
            for ground in GROUND
        ]
        yield f"| {line.name} | {' | '.join(cells)} |"


def main() -> int:
    """Read the command line, run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=1, help="runs of each cell")
    parser.add_argument("--random", type=int, default=4, help="random lines")
    parser.add_argument("--only", default="", help="lines whose name holds this")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    drawn = [draw(seed, payload_link="left_hand") for seed in range(arguments.random)]
    lines = [line for line in (*LINES, *drawn) if arguments.only in line.name]
    told = []
    for row in rows(lines, arguments.seeds):
        print(row, flush=True)
        told.append(row)
    if arguments.out is not None:
        arguments.out.write_text("\n".join(told) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
