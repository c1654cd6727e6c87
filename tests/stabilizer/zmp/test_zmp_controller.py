"""What the baseline answers before it knows its sensors."""

from __future__ import annotations

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.zmp.controller import ZmpController

SETTINGS = build_settings({}, overrides=["estimator.calibration_s=0.02"])
WARM_TICKS = 80


def test_no_forces_are_desired_before_calibration_has_ended(
    walker: Robot, snapshot: Snapshot
) -> None:
    controller = ZmpController(walker, SETTINGS)
    controller.start(snapshot, walker.nominal)
    first = controller.step(snapshot, None)
    assert first.F_id is None
    for _ in range(WARM_TICKS):
        last = controller.step(snapshot, None)
    assert last.F_id is not None
    assert last.F_id[2] > 0.0
