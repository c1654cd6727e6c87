"""The controller and the simulated robot in one process, tick by tick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings
from surefoot.simulation import Simulation
from surefoot.stabilizer.controller import Controller, ControllerOutput
from surefoot.stabilizer.whole_body.controller import WholeBodyController

NOISE = {
    "force_noise_n": 2.0,
    "moment_noise_nm": 0.1,
    "gyro_noise_rad_s": 0.002,
    "accel_noise_m_s2": 0.05,
}
DELAY = {"command_ms": 1.0}


def swing(
    axis: str, size: float, frequency_hz: float, *, start_s: float = 0.0
) -> dict[str, Any]:
    """Return a sine motion of the ground [deg], or [m] along z."""
    amplitude = "amplitude_m" if axis == "z" else "amplitude_deg"
    motion = {"axis": axis, "kind": "sine", "frequency_hz": frequency_hz}
    return {**motion, amplitude: size, "start_s": start_s}


ROLLING = [{"foot": "both", "motion": [swing("roll", 3.0, 2.0)]}]
"""A platform under both feet that moves from the start."""


@dataclass(frozen=True)
class Run:
    """A run in closed loop, with one row per tick.

    Attributes:
        time_s: (n,) simulated time [s].
        snapshots: the controller's inputs.
        commands: (n, n_a) its commands, bus order [rad].
        com_true: (n, 3) true CoM in the world [m].
        soles_true: (n, 2, 3) left and right sole in the world [m].
        F_true: (n, 12) true contact wrenches, sole frames [N, N m].
        F_meas: (n, 12) the controller's measured wrenches, sole frames [N, N m].
        com: (n, 3) estimated CoM in the stance frame [m].
        com_reference: (n, 3) its reference in the stance frame [m].
        statuses: the different statuses of the QPs.
        fell: whether the robot fell.
    """

    time_s: Array
    snapshots: list[Snapshot]
    commands: Array
    com_true: Array
    soles_true: Array
    F_true: Array
    F_meas: Array
    com: Array
    com_reference: Array
    statuses: set[str]
    fell: bool


def run_closed_loop(
    robot: Robot,
    *,
    seed: int = 0,
    controller: Controller | None = None,
    **scenario: Any,
) -> Run:
    """Run a scenario; other keywords are its keys; noise and delay as shipped.

    The default is the whole-body controller with its default settings.
    """
    table = {"name": "test", "sensors": NOISE, "delay": DELAY, **scenario}
    sim = Simulation(robot, scenario_from_table(table, source="test"), seed=seed)
    controller = controller or WholeBodyController(robot, ControllerSettings())
    rows: dict[str, list[Any]] = {
        name: []
        for name in Run.__dataclass_fields__
        if name not in ("statuses", "fell")
    }
    statuses = set()
    output: ControllerOutput | None = None
    while not sim.finished:
        time_s, snapshot, truth = sim.time_s, sim.snapshot, sim.truth
        output = sim.step(controller) or output
        assert output is not None
        statuses.add(output.qp_status)
        rows["time_s"].append(time_s)
        rows["snapshots"].append(snapshot)
        rows["commands"].append(output.q_command.copy())
        rows["com_true"].append(truth.com)
        rows["soles_true"].append([truth.sole_left, truth.sole_right])
        rows["F_true"].append(np.concatenate((truth.F_left, truth.F_right)))
        rows["F_meas"].append(np.array(output.F_meas))
        rows["com"].append(np.array(output.com))
        rows["com_reference"].append(np.array(output.com_reference))
    snapshots = rows.pop("snapshots")
    arrays = {name: np.array(values) for name, values in rows.items()}
    return Run(snapshots=snapshots, statuses=statuses, fell=sim.fell, **arrays)
