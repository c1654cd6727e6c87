"""Other humanoids, from their URDFs to a table of how they stand, untuned.

Their URDFs come in wheels of their own, none is part of this project:
``pip install -e '.[humanoids]'``. Then::

    python -m benchmarks.humanoids --robots jvrc g1 --seeds 2

makes each robot as ``surefoot new-robot`` does, without an edit, and runs every
scenario scaled to what it reaches.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import surefoot as sf
from surefoot.robot_files.new_robot import NewRobot, NewRobotOptions, new_robot
from surefoot.robot_files.scenario_fit import fit, scale_to_robot
from surefoot.robot_io.robot import Robot
from surefoot.schemas.scenario import Push, Scenario

PUSH_SHARE = 0.6
DIRECTIONS_DEG = tuple(range(0, 360, 45))
NAMED = (
    *("moving-platform-slow", "moving-platform-fast", "two-platforms-fast"),
    *("falling-platform-50", "tilt-ramp-roll"),
)


class NoWheelError(LookupError):
    """The wheel with a robot's URDF is not installed."""


@dataclass(frozen=True)
class Humanoid:
    """A robot of a wheel.

    Attributes:
        wheel: what to install.
        urdf: how the path of its URDF ends.
        options: what is to be said about it.
    """

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


def scenarios(robot: Robot, names: list[str]) -> Iterator[tuple[str, Scenario]]:
    """Yield each scenario as this robot can reach it, under a name that says so."""
    if "standing" in names:
        yield "standing, 5 s", Scenario(name="standing", duration_s=5.0)
    for name in NAMED:
        if name in names:
            whole = sf.load_scenario(name)
            scaled, _ = scale_to_robot(whole, robot)
            share = 0.9 * fit(whole, robot).ground_share
            told = name if scaled == whole else f"{name}, {100.0 * share:.0f} %"
            yield told, scaled
    if "push" in names:
        for direction in DIRECTIONS_DEG:
            push = Push(impulse_share=PUSH_SHARE, direction_deg=direction, start_s=1.0)
            yield (
                f"push {PUSH_SHARE}, {direction} deg",
                Scenario(name="push", duration_s=4.0, push=[push]),
            )


def main() -> None:
    """Make the robots and print a row for each scenario."""
    known = ["standing", *NAMED, "push"]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", choices=HUMANOIDS, default=[*HUMANOIDS])
    parser.add_argument("--scenarios", nargs="+", choices=known, default=known)
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    print("| robot | scenario | up | CoM rms x, y, z [mm] | tilt max [deg] |")
    print("|---|---|---|---|---|")
    for name in options.robots:
        with tempfile.TemporaryDirectory() as folder:
            try:
                robot = HUMANOIDS[name].make(Path(folder)).robot
            except NoWheelError as error:
                sys.exit(f"{name}: {error}")
            for told, scenario in scenarios(robot, options.scenarios):
                runs = [
                    sf.simulate(robot, scenario, seed=seed, record=False)
                    for seed in range(options.seeds)
                ]
                print(f"| {name} | {told} | {row(runs)} |", flush=True)


def row(runs: list[sf.Run]) -> str:
    """How many stood, and the worst figures of those."""
    up = [run.result for run in runs if run.outcome.is_up]
    text = f"{len(up)}/{len(runs)}"
    if not up:
        return f"{text} | {runs[0].result.outcome_detail} | "
    rms = [max(axis) for axis in zip(*(r.com_error_rms_mm for r in up), strict=True)]
    tilt = max(result.base_tilt_max_deg for result in up)
    return f"{text} | {', '.join(f'{mm:.1f}' for mm in rms)} | {tilt:.1f}"


if __name__ == "__main__":
    main()
