"""A gate in use."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import CommandResult
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import SCHEMA_VERSION, JointCommand

WALKER = load_robot("walker")
GATE = WALKER.file.gate
PERIOD_S = WALKER.period_s
ROUNDING_RAD = 1e-12
NOT_A_POSTURE = np.full(WALKER.n_a, math.nan)


def command(q: Array, tick: int = 0, **changes: Any) -> JointCommand:
    """Return ann's joint command for a tick; ``changes`` replace fields of it."""
    fields: dict[str, Any] = {
        "schema": SCHEMA_VERSION,
        "tick": tick,
        "stamp_ns": 0,
        "q": np.asarray(q).tolist(),
        "commander": "ann",
        "sequence": tick,
    }
    return JointCommand(**{**fields, **changes})


def active_gate(robot: Robot = WALKER) -> CommandGate:
    """Return a gate that holds the nominal posture and follows ann."""
    gate = CommandGate(robot, robot.nominal)
    assert gate.request("take", "ann", now_s=0.0).accepted
    assert gate.request("enable", "ann", now_s=0.0).accepted
    return gate


def at_tick(
    gate: CommandGate, tick: int, q: Array | None = None, **changes: Any
) -> CommandResult:
    """Begin a tick and command a posture; the present one by default."""
    gate.begin_tick(now_s=tick * PERIOD_S)
    wanted = gate.posture if q is None else q
    return gate.accept(
        command(wanted, tick, **changes), tick=tick, now_s=tick * PERIOD_S
    )


def offset(joint: str, by_rad: float) -> Array:
    posture = WALKER.nominal.copy()
    posture[WALKER.joint_names.index(joint)] += by_rad
    return posture
