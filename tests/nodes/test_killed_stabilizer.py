"""The whole-body stabilizer is killed repeatedly while the robot stands."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np

from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import EndReason, ModeCause
from surefoot.signals import read_signals
from tests.nodes.processes import balancing, recorded_robot, running
from tests.nodes.test_nodes import NOISE, is_running, observer

WALKER = load_robot("walker")
TABLE = {"duration_s": 3600.0, "sensors": NOISE}
KILLS = 2
ROUNDING_RAD = 1e-12


def test_a_killed_stabilizer_never_makes_the_robot_jump_and_the_next_one_goes_on(
    endpoints: Endpoints, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    with (
        running(recorded_robot, endpoints, TABLE, tmp_path / "ticks.mcap") as plant,
        observer(endpoints) as when,
    ):
        for index in range(KILLS + 1):
            name = f"ann-{index}"
            with running(balancing, endpoints, name) as controller:
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
            assert held.commander == ""
            assert name in held.detail
            if index < KILLS:
                assert held.cause is ModeCause.COMMANDER_GONE
                assert held.detail == f"{name} is gone"
        plant.signal(signal.SIGINT)
        run = plant.result()
        assert plant.exit_code() == 0
    assert (run.end, run.end_detail) == (ModeCause.STOPPED, "SIGINT")
    assert not run.fell
    assert run.clipped == {}
    signals = read_signals(tmp_path / "ticks.mcap")
    assert signals.count == run.ticks
    steps = np.abs(np.diff(signals["q_command"], axis=0))
    limit = WALKER.file.gate.step_limit_rad
    assert 0.0 < steps.max() <= limit + ROUNDING_RAD
    quat_xyzw = signals["true_base_pose"][-1, 3:]
    assert 2.0 * np.linalg.norm(quat_xyzw[:2]) < 0.05  # leans by less than 3 deg
