"""The whole baseline, tick by tick: mirror image, failures, feet in the air."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.zmp.controller import ZmpController
from tests.stabilizer.closed_loop import Run, run_closed_loop, swing
from tests.stabilizer.mirror import Mirror
from tests.stabilizer.standing_snapshot import (
    airborne_snapshot,
    standing_reference,
)

SOON = ["estimator.calibration_s=0.02", "dik.ramp_in_s=0.02"]
SETTINGS = build_settings({}, overrides=SOON)
WARM_TICKS, BAD_TICKS, GOOD_TICKS = 80, 5, 30
FASTEST_STEP_RAD = SETTINGS.dik.velocity_limit_rad_s * 1e-3
SYMMETRY_RAD = 1e-8
OK = "ok"
SENSORS = ["q", "dq", "angular_velocity", "linear_acceleration", "ft_left", "ft_right"]
MOTION = [swing("roll", 6.0, 0.7, start_s=0.4), swing("pitch", 6.0, 0.5, start_s=0.4)]
PLATFORM = [{"foot": "both", "motion": MOTION}]


@pytest.fixture
def controller(walker: Robot, snapshot: Snapshot) -> ZmpController:
    """Return a controller after its calibration, and moving."""
    controller = ZmpController(walker, SETTINGS)
    controller.start(snapshot, walker.nominal)
    assert statuses(controller, snapshot, ticks=WARM_TICKS) == {OK}
    return controller


@pytest.fixture(scope="module")
def short_run(walker: Robot) -> Run:
    return run_closed_loop(
        walker,
        seed=5,
        controller=ZmpController(walker, ControllerSettings()),
        duration_s=0.8,
        platform=PLATFORM,
    )


def statuses(controller: ZmpController, snapshot: Snapshot, *, ticks: int) -> set[str]:
    return {controller.step(snapshot).qp_status for _ in range(ticks)}


def command(output: ControllerOutput) -> np.ndarray:
    return output.q_command.copy()


def test_it_is_made_by_its_name(walker: Robot) -> None:
    made = make_controller("zmp", walker, ControllerSettings())
    assert isinstance(made, ZmpController)


def test_mirrored_readings_give_mirrored_commands(
    walker: Robot, model: RobotModel, short_run: Run
) -> None:
    mirror = Mirror(model)
    controller = ZmpController(walker, ControllerSettings())
    first, *rest = short_run.snapshots
    controller.start(mirror.snapshot(first), mirror.joints(walker.nominal))
    commands = [command(controller.step(mirror.snapshot(s))) for s in (first, *rest)]
    desired = [mirror.joints(answer) for answer in short_run.commands]
    assert np.abs(np.array(commands) - np.array(desired)).max() < SYMMETRY_RAD


def test_same_readings_give_the_same_commands_bit_for_bit(
    walker: Robot, short_run: Run
) -> None:
    controller = ZmpController(walker, ControllerSettings())
    controller.start(short_run.snapshots[0], walker.nominal)
    again = np.array([command(controller.step(s)) for s in short_run.snapshots])
    np.testing.assert_array_equal(again, short_run.commands)


@pytest.mark.parametrize("sensor", SENSORS)
def test_sensor_without_numbers_is_survived(
    controller: ZmpController, snapshot: Snapshot, sensor: str
) -> None:
    before = command(controller.step(snapshot))
    blank = replace(
        snapshot, **{sensor: np.full_like(getattr(snapshot, sensor), np.nan)}
    )
    for _ in range(BAD_TICKS):
        output = controller.step(blank)
        assert output.qp_status != OK
        np.testing.assert_array_equal(output.q_command, before)
    assert statuses(controller, snapshot, ticks=GOOD_TICKS) == {OK}


@pytest.mark.parametrize(
    "mad", [{"com": [1e300, 0.0, 0.0]}, {"com": [0.0, 0.0, 1e300]}]
)
def test_mad_reference_gives_no_jump_and_is_forgotten(
    controller: ZmpController, snapshot: Snapshot, mad: dict[str, list[float]]
) -> None:
    sane = standing_reference(controller.model)
    answers = [command(controller.step(snapshot))]
    for reference in [msgspec.structs.replace(sane, **mad), *[sane] * GOOD_TICKS]:
        output = controller.step(snapshot, reference)
        assert output.qp_status == OK
        answers.append(command(output))
    moved = np.abs(np.diff(np.array(answers), axis=0))
    assert moved.max() <= FASTEST_STEP_RAD * (1.0 + 1e-9)


def test_infeasible_problem_is_a_status_kept_for_replay(
    controller: ZmpController, snapshot: Snapshot
) -> None:
    before = command(controller.step(snapshot))
    sane = standing_reference(controller.model)
    posture = [1e308] * controller.model.n_a
    with np.errstate(over="ignore"):
        output = controller.step(
            snapshot, msgspec.structs.replace(sane, posture=posture)
        )
    assert output.qp_status.startswith("motion")
    assert controller.failure is not None
    np.testing.assert_array_equal(output.q_command, before)
    assert controller.step(snapshot, sane).qp_status == OK


def test_in_the_air_it_goes_on_and_finds_the_ground_again(
    controller: ZmpController, snapshot: Snapshot, model: RobotModel
) -> None:
    for _ in range(GOOD_TICKS):
        output = controller.step(airborne_snapshot(model))
    assert output.qp_status == OK
    assert output.in_contact == (False, False)
    np.testing.assert_array_equal(output.F_id, 0.0)
    for _ in range(GOOD_TICKS):
        output = controller.step(snapshot)
    assert output.in_contact == (True, True)


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
