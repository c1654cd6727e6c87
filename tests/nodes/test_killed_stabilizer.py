"""The whole-body stabilizer killed on the standing robot, again and again."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.robot_io.realtime import Pace
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.ticks.write import TickFile
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import EndReason
from surefoot.schemas.result import PlantResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.signals import read_signals
from surefoot.sim_robot.robot_loop import run_robot
from surefoot.stabilizer.control.whole_body import WholeBodyController
from surefoot.stabilizer.node import run_stabilizer
from tests.nodes.processes import SEED, running
from tests.nodes.test_nodes import NOISE, is_running, observer
from tests.support import PATIENCE_S

WALKER = load_robot("walker")
TABLE = {"duration_s": 3600.0, "sensors": NOISE}
KILLS = 2
ROUNDING_RAD = 1e-12


def recorded_robot(endpoints: Endpoints, record: Path) -> PlantResult:
    scenario = scenario_from_table({"name": "test", **TABLE}, source="test")
    with TickFile(record, may_wait=True) as ticks:
        return run_robot(
            WALKER,
            scenario,
            seed=SEED,
            endpoints=endpoints,
            pace=Pace.LOCKSTEP,
            ticks=ticks,
            wait_s=PATIENCE_S,
        )


def whole_body(endpoints: Endpoints, identity: str) -> Any:
    return run_stabilizer(
        lambda settings: WholeBodyController(WALKER, settings),
        WALKER,
        endpoints=endpoints,
        pace=Pace.LOCKSTEP,
        identity=identity,
        connect_timeout_s=PATIENCE_S,
    )


def test_a_killed_stabilizer_never_makes_the_robot_jump_and_the_next_one_goes_on(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    with (
        running(recorded_robot, endpoints, tmp_path / "ticks.mcap") as plant,
        observer(endpoints) as when,
    ):
        for index in range(KILLS + 1):
            name = f"ann-{index}"
            with running(whole_body, endpoints, name) as controller:
                first = when(
                    lambda s, name=name: s.commander == name and is_running(s),
                    what=f"{name} in command",
                )
                end = first.tick + int(rng.integers(50, 800))
                when(lambda s, end=end: s.tick >= end, what=f"tick {end}")
                if index == KILLS:
                    controller.signal(signal.SIGTERM)
                    assert controller.result().end is EndReason.STOPPED
                else:
                    controller.kill()
            held = when(lambda s: s.mode is RobotMode.HOLD, what="HOLD")
            assert name in held.detail
        plant.signal(signal.SIGINT)
        run = plant.result()
    assert not run.fell
    assert run.clipped == {}
    signals = read_signals(tmp_path / "ticks.mcap")
    assert signals.count == run.ticks
    steps = np.abs(np.diff(signals["q_command"], axis=0))
    limit = WALKER.file.gate.step_limit_rad
    assert 0.0 < steps.max() <= limit + ROUNDING_RAD
    quat_xyzw = signals["true_base_pose"][-1, 3:]
    assert 2.0 * np.linalg.norm(quat_xyzw[:2]) < 0.05  # leans by less than 3 deg
