"""Other humanoids, made from their URDFs and untuned: a table of how well they stand.

Their URDFs come in separate wheels and are not part of this project:
``pip install -e '.[humanoids]'``. Then::

    python -m benchmarks.humanoids [--robots jvrc g1] [--cells slow push] [--seeds 2]

makes each robot as ``surefoot new-robot`` does, without an edit, and runs every cell
with each of its servo profiles. A cell is a shipped scenario, scaled to the robot's
reach and cut short (``--whole`` runs all of it), or a push from each of eight
directions. Prints a row per robot and profile; each fall is named on stderr.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import NamedTuple

import msgspec

import surefoot as sf
from surefoot.robot_files.new_robot import NewRobot, NewRobotOptions, new_robot
from surefoot.robot_files.scenario_fit import scale_to_robot
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.schemas.scenario import Push, Scenario

PUSH_SHARE = 0.6
DIRECTIONS_DEG = tuple(range(0, 360, 45))


class Cell(NamedTuple):
    """A column of the table: a shipped scenario, and how long it is run."""

    scenario: str
    seconds: float


CELLS = {
    "standing": Cell("standing", 4.0),
    "slow": Cell("moving-platform-slow", 8.0),
    "fast": Cell("moving-platform-fast", 6.0),
    "two": Cell("two-platforms-fast", 6.0),
    "drop": Cell("falling-platform-50", 6.0),
    "tilt": Cell("tilt-ramp-roll", 4.0),
    "push": Cell("push-standing", 3.0),
}


class NoWheelError(LookupError):
    """The wheel with a robot's URDF is not installed."""


@dataclass(frozen=True)
class Humanoid:
    """A robot from a wheel."""

    wheel: str
    urdf: str
    options: NewRobotOptions

    def find(self) -> Path:
        """Return the path of its URDF.

        Raises:
            NoWheelError: the wheel is not installed.
        """
        try:
            listed = files(self.wheel) or []
        except PackageNotFoundError as error:
            raise NoWheelError(
                f"no {self.wheel}: pip install -e '.[humanoids]'"
            ) from error
        found = next(file for file in listed if str(file).endswith(self.urdf))
        return Path(str(found.locate())).resolve()

    def make(self, out: Path) -> NewRobot:
        """Make the robot as the command does."""
        return new_robot(self.find(), self.options, out=out)


_EXAMPLE = "example-robot-data"
_JVRC = ("jvrc_description", "urdf/jvrc1.urdf")
HUMANOIDS = {
    "jvrc": Humanoid(
        *_JVRC, NewRobotOptions("L_ANKLE_P_S", "R_ANKLE_P_S", name="jvrc")
    ),
    "jvrc-legs": Humanoid(
        *_JVRC,
        NewRobotOptions("L_ANKLE_P_S", "R_ANKLE_P_S", name="jvrc-legs", legs_only=True),
    ),
    "talos": Humanoid(
        _EXAMPLE,
        "robots/talos_reduced.urdf",
        NewRobotOptions("left_sole_link", "right_sole_link", repair_inertias=True),
    ),
    "g1": Humanoid(
        _EXAMPLE,
        "urdf/g1_29dof_rev_1_0.urdf",
        NewRobotOptions("left_ankle_roll_link", "right_ankle_roll_link", name="g1"),
    ),
    "romeo": Humanoid(
        _EXAMPLE,
        "urdf/romeo.urdf",
        NewRobotOptions("l_sole", "r_sole", repair_inertias=True),
    ),
    "icub": Humanoid(
        "icub-models",
        "iCubGazeboV2_7/model.urdf",
        NewRobotOptions("l_sole", "r_sole", name="icub"),
    ),
}


def scenarios(robot: Robot, name: str, *, whole: bool) -> tuple[list[Scenario], float]:
    """Return a cell's scenarios, and the remaining share of the ground's motion."""
    cell = CELLS[name]
    shipped = sf.load_scenario(cell.scenario)
    if name == "push":
        found = [
            msgspec.structs.replace(
                shipped,
                name=f"push at {direction} deg",
                push=[
                    Push(impulse_share=PUSH_SHARE, direction_deg=direction, start_s=1.0)
                ],
            )
            for direction in DIRECTIONS_DEG
        ]
        share = 1.0
    else:
        found = [scale_to_robot(shipped, robot)[0]]
        share = _share(found[0], shipped)
    if not whole:
        found = [msgspec.structs.replace(s, duration_s=cell.seconds) for s in found]
    return found, share


def _share(scaled: Scenario, shipped: Scenario) -> float:
    for after, before in zip(scaled.platform, shipped.platform, strict=True):
        for one, other in zip(after.motion, before.motion, strict=True):
            return one.amplitude / other.amplitude  # type: ignore[union-attr]  # all shipped: sines, ramps
    return 1.0


def run_cell(
    robot: Robot, name: str, *, seeds: int, whole: bool
) -> tuple[list[bool], str]:
    """Run a cell; return which of its runs stood, and its text in the table."""
    todo, share = scenarios(robot, name, whole=whole)
    stood, worst = [], 0.0
    for scenario in todo:
        for seed in range(seeds):
            run = sf.simulate(robot, scenario, seed=seed, record=False)
            stood.append(run.outcome.is_up)
            if run.outcome.is_up:
                worst = max(worst, *(run.result.com_error_rms_mm or ()))
            else:
                print(
                    f"{robot.file.name}, {robot.file.servo.profile}: {scenario.name}, "
                    f"seed {seed}: {run.result.outcome_detail}",
                    file=sys.stderr,
                    flush=True,
                )
    scaled = "" if share == 1.0 else f" at {100.0 * share:.0f} %"
    figure = f", {worst:.1f}" if any(stood) else ""
    return stood, f"{sum(stood)}/{len(stood)}{scaled}{figure}"


def main() -> None:
    """Make the robots and print a row for each of their servo profiles."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", choices=HUMANOIDS, default=[*HUMANOIDS])
    parser.add_argument("--cells", nargs="+", choices=CELLS, default=[*CELLS])
    parser.add_argument("--servo-profiles", nargs="+", default=["ideal", "harmonic"])
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--whole", action="store_true")
    options = parser.parse_args()
    print(f"| robot, servos | {' | '.join(options.cells)} | up |")
    print(f"|---|{'---|' * len(options.cells)}---|")
    total: list[bool] = []
    for name in options.robots:
        with tempfile.TemporaryDirectory() as folder:
            try:
                path = HUMANOIDS[name].make(Path(folder)).robot.path
            except NoWheelError as error:
                sys.exit(f"{name}: {error}")
            for profile in options.servo_profiles:
                robot = load_robot(path, servo_profile=profile)
                row: list[bool] = []
                texts = []
                for cell in options.cells:
                    stood, text = run_cell(
                        robot, cell, seeds=options.seeds, whole=options.whole
                    )
                    row += stood
                    texts.append(text)
                total += row
                told = (f"{name}, {profile}", *texts, f"{sum(row)}/{len(row)}")
                line = " | ".join(told)
                print(f"| {line} |", flush=True)
    print(f"\nup: {sum(total)} of {len(total)}")


if __name__ == "__main__":
    main()
