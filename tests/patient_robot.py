"""What stands in real time on a machine of any speed, for tests of something else.

On a busy machine commands come late. The Walker's gate then holds, or gives up, as it
should; and a stabilizer that yields to forces sways with old readings, as it must.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec

from surefoot.robot_io.robot import Robot, find_robot, load_robot
from surefoot.schemas.settings import ControllerSettings, build_settings

HOLD_AFTER_S = 0.5
"""Silence of a commander that the robot takes for the loss of it."""
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
"""For a conformance run, which waits for the gate to lose patience and sends what is
a second old: long against the pauses of a busy machine, short enough to wait for."""
GENTLE = ("dik.k_force=-1000", "ground.gain=0")
"""Yields so slowly that it stands still with readings 50 ms old, where the defaults
sway from 5 ms on."""


def patient(robot: Robot, **gate: float) -> Robot:
    """The same robot with a gate that waits long for its commander.

    Args:
        robot: the robot.
        gate: values of the gate's table that shall be others.
    """
    changed = msgspec.structs.replace(robot.file.gate, **{**GATE, **gate})
    return replace(robot, file=msgspec.structs.replace(robot.file, gate=changed))


def judged_walker() -> Robot:
    """The Walker for a conformance run."""
    return patient(load_robot("walker"), **JUDGED)


def patient_robot_file(folder: Path, below: Path | None = None, **gate: float) -> Path:
    """The same, as a robot file on top of another.

    Args:
        folder: gets ``patient.toml``.
        below: the other one; the Walker's when None.
        gate: values of the gate's table that shall be others.
    """
    values = "\n".join(f"{key} = {value}" for key, value in {**GATE, **gate}.items())
    path = folder / "patient.toml"
    below = below or find_robot("walker")
    path.write_text(f'extends = "{below}"\n[gate]\n{values}\n')
    return path


def gentle_settings() -> ControllerSettings:
    """Settings of a stabilizer that stands with old readings."""
    return build_settings({}, overrides=list(GENTLE))
