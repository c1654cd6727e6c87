"""A robot and settings that stand in real time on a machine of any speed.

For tests of something else. On a busy machine commands come late. The Walker's gate
then holds or goes to fault, and a stabilizer that yields to forces sways with old
readings. Both are correct, but would disturb those tests.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec

from surefoot.robot_io.robot import Robot, find_robot, load_robot
from surefoot.schemas.settings import ControllerSettings, build_settings

HOLD_AFTER_S = 0.5
"""Silence of a commander after which the robot holds [s]."""
GATE = {
    "hold_after_s": HOLD_AFTER_S,
    "fault_after_s": 600.0,
    "lease_s": 2.0,
    "max_command_age_s": 10.0,
    "max_loop_delay_s": 10.0,
}
JUDGED = {
    "hold_after_s": 0.3,
    "fault_after_s": 2.0,
    "max_command_age_s": 0.5,
}
"""Times for a conformance run [s].

It waits until the gate holds, and sends commands a second old. So the times are longer
than the pauses of a busy machine, but short enough to wait for.
"""
GENTLE = ("dik.k_force=-1000", "ground.gain=0")
"""A foot yields so slowly that readings 50 ms old do no harm; defaults bear 5 ms."""


def patient(robot: Robot, **gate: float) -> Robot:
    """Return the same robot with a gate that waits long for its commander.

    Args:
        robot: the robot.
        gate: values of the gate's table to change.
    """
    changed = msgspec.structs.replace(robot.file.gate, **{**GATE, **gate})
    return replace(robot, file=msgspec.structs.replace(robot.file, gate=changed))


def judged_walker() -> Robot:
    """Return the Walker for a conformance run."""
    return patient(load_robot("walker"), **JUDGED)


def patient_robot_file(folder: Path, below: Path | None = None, **gate: float) -> Path:
    """Write the same as a robot file that extends another one.

    Args:
        folder: where ``patient.toml`` is written.
        below: the extended file; the Walker's when None.
        gate: values of the gate's table to change.
    """
    values = "\n".join(f"{key} = {value}" for key, value in {**GATE, **gate}.items())
    path = folder / "patient.toml"
    below = below or find_robot("walker")
    path.write_text(f'extends = "{below}"\n[gate]\n{values}\n')
    return path


def gentle_settings() -> ControllerSettings:
    """Return settings of a stabilizer that stands with old readings."""
    return build_settings({}, overrides=list(GENTLE))
