"""Balance of a robot with realistic sensors and drives.

    python -m benchmarks.reality [--count 1] [--random 4] [--only WORD ...]
        [--grounds moving-platform-fast ...] [--out FOLDER]

Each line is one imperfection, or all of them at once, given as tables of a scenario
file. They are put into shipped scenarios that are cut short. Random lines are drawn
with their number in ``draw``: mounting, errors, rates and delays of sensors, drives,
model errors, a payload. Writes Markdown: how many runs stood, with Wilson's 95 %
interval, and their largest lasting error. Runs that did not stand are printed before,
each with its outcome. To add a line of your own, add an entry to ``LINES``.
"""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from benchmarks.lines import LineRun, pivot, run_all, share_in_words, study_options
from benchmarks.mounted import Drawing, write_mounted
from benchmarks.started import shortened
from surefoot.robot_io.robot import load_robot
from surefoot.run_plan import RunPlan
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.studies.cell import Row, is_up

Tables = dict[str, Any]
GROUND = {"standing": 4.0, "moving-platform-slow": 10.0, "moving-platform-fast": 5.0}
"""Shipped scenarios, each with the duration of its run [s]."""
SLOW_DRIVES = "harmonic"
PAYLOAD_LINK = "left_hand"


class Line(NamedTuple):
    """Imperfections of one robot.

    Attributes:
        name: shown in the table.
        tables: tables of the scenario that are laid over those of the shipped one.
        servo_profile: servo profile of the drives.
        drawing: mounting of the sensors; None for the Walker's.
    """

    name: str
    tables: Tables
    servo_profile: str = "ideal"
    drawing: Drawing | None = None


def sensors(**values: Any) -> Tables:
    """Return the tables of one line with sensor errors."""
    return {"sensors": values}


LINES = (
    Line("none", {}),
    Line("accelerometer +0.008 m/s^2", sensors(accel_bias_m_s2=0.008)),
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
        "payload 3 kg in one hand",
        {"payload": [{"link": PAYLOAD_LINK, "mass_kg": 3.0}]},
    ),
    Line("starts on moving ground", {"platform": {"start_s": 0.0}}),
)
"""Lines with one imperfection each."""


def draw(number: int) -> Line:
    """Return a line with all imperfections at once, within limits of data sheets."""
    rng = np.random.default_rng(number)

    def within(size: float) -> list[float]:
        return [round(float(x), 5) for x in rng.uniform(-size, size, 3)]

    def between(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 4)

    def anyhow(size: float) -> pin.SE3:
        turn = pin.Quaternion(*rng.normal(size=4)).normalized()
        return pin.SE3(turn.matrix(), rng.uniform(-size, size, 3))

    joints = load_robot("walker").joint_names
    tables = {
        "sensors": {
            "accel_bias_m_s2": within(0.3),
            "accel_drift_m_s2_min": within(0.01),
            "gyro_bias_rad_s": within(0.02),
            "gyro_drift_rad_s_min": within(0.002),
            "force_bias_n": {"left": within(5.0), "right": within(5.0)},
            "moment_bias_nm": {"left": within(0.5), "right": within(0.5)},
            "force_scale": between(0.98, 1.02),
            "encoder_offset_rad": {name: between(-2e-3, 2e-3) for name in joints},
            "encoder_resolution_rad": 2.0 * np.pi / 2**16,
            "force_torque_rate_hz": float(rng.choice([500.0, 1000.0])),
            "imu_rate_hz": float(rng.choice([500.0, 1000.0])),
            "joints_rate_hz": float(rng.choice([500.0, 1000.0])),
        },
        "delay": {"sensor_ms": float(rng.integers(2))},
        "model_error": {
            "gravity_m_s2": between(9.76, 9.84),
            "mass_scale": between(0.97, 1.03),
            "servo_kp_scale": between(0.9, 1.1),
            "servo_lag_scale": between(0.7, 1.3),
            "backlash_rad": between(0.0, 5e-4),
            "joint_friction_nm": between(0.0, 1.0),
        },
        "payload": [{"link": PAYLOAD_LINK, "mass_kg": between(0.5, 3.0)}],
        "start": {"yaw_deg": between(-180.0, 180.0)},
    }
    drives = SLOW_DRIVES if rng.random() < 0.5 else "ideal"
    drawing = Drawing(imu=anyhow(0.1), feet=(anyhow(0.02), anyhow(0.02)))
    return Line(f"random {number}, {drives}", tables, drives, drawing)


def lay_over(text: str, tables: Tables) -> Tables:
    """Return a scenario's tables with those of a line laid over them.

    Args:
        text: content of the scenario file.
        tables: tables of the line; keys of ``platform`` go into every motion.
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


@dataclass(frozen=True)
class RealRun(LineRun):
    """One run of an imperfect robot.

    Attributes:
        ground: shipped scenario on which it stands.
        of: line with the imperfections.
        mounted: its robot file if sensors are mounted differently; else None.
    """

    ground: str
    of: Line
    mounted: Path | None = None

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        return f"{super().key}|{self.ground}"

    def scenario(self) -> Scenario:
        """Return the scenario of its ground with the imperfections laid over it."""
        raw = lay_over(shortened(self.ground, GROUND[self.ground]), self.of.tables)
        return scenario_from_table(raw, source=f"{self.line} on {self.ground}")

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return its plan; see the base class."""
        return super().plan(robot=str(self.mounted or robot), overrides=overrides)


def cell(rows: Sequence[Row]) -> str:
    """Return how many runs stood, and their largest lasting error [mm]."""
    up = [row for row in rows if is_up(row)]
    errors = [row["com_error_rms_mm"] for row in up if row["com_error_rms_mm"]]
    told = "; ".join(f"{max(axis):.1f}" for axis in zip(*errors, strict=True))
    if len(rows) == 1:
        return told or f"**{rows[0]['outcome']}**"
    return f"{share_in_words(rows)}: {told}"


def table(runs: Sequence[RealRun], rows: Sequence[Row]) -> str:
    """Return the Markdown table: a row per line and a column per ground."""
    cells: dict[tuple[str, str], list[Row]] = {}
    for run, row in zip(runs, rows, strict=True):
        cells.setdefault((run.line, run.ground), []).append(row)
    told = pivot("imperfection", cells, cell)
    for ground in dict.fromkeys(ground for _, ground in cells):
        of = [row for (_, on), each in cells.items() if on == ground for row in each]
        told += f"\n{ground}: {share_in_words(of)} stood\n"
    return told.rstrip("\n")


def main() -> int:
    """Read the command line, run and print."""
    parser = study_options(__doc__, count=1)
    parser.add_argument("--random", type=int, default=4, help="random lines")
    parser.add_argument("--grounds", nargs="+", default=list(GROUND), choices=GROUND)
    options = parser.parse_args()
    every = (*LINES, *(draw(number) for number in range(options.random)))
    lines = [line for line in every if any(word in line.name for word in options.only)]
    with tempfile.TemporaryDirectory() as folder:
        runs = [
            RealRun(
                line.name,
                number,
                controller,
                line.servo_profile,
                ground=ground,
                of=line,
                mounted=robot_of(line, Path(folder)),
            )
            for line in lines
            for ground in options.grounds
            for controller in options.controllers
            for number in range(options.first, options.first + options.count)
        ]
        rows = run_all(runs, options, title="reality")
    print(table(runs, rows))
    return 0


def robot_of(line: Line, folder: Path) -> Path | None:
    """Write the robot file of a line's mounting; None if it is the Walker's."""
    if line.drawing is None:
        return None
    name = line.name.partition(",")[0].replace(" ", "-")
    inside = folder / name
    if not inside.exists():
        inside.mkdir()
        write_mounted(inside, line.drawing)
    return inside / f"{name}.toml"


if __name__ == "__main__":
    raise SystemExit(main())
