"""A tick that cannot be solved is reported, survived and kept for replay."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.controller import BalanceController, ControllerOutput
from surefoot.stabilizer.factory import make_controller
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from surefoot.stabilizer.zmp.controller import ZmpController
from tests.stabilizer.same_answer import filled
from tests.stabilizer.standing_snapshot import (
    airborne_snapshot,
    standing_reference,
)

WARM_TICKS, BAD_TICKS, GOOD_TICKS = 80, 5, 30
PERIOD_S = 0.001
SETTINGS = build_settings(
    {}, overrides=["estimator.calibration_s=0.02", "dik.ramp_in_s=0.02"]
)
"""Short calibration and fade-in."""
FASTEST_STEP_RAD = SETTINGS.dik.velocity_limit_rad_s * PERIOD_S
OK = "ok"
LAWS = {"whole-body": WholeBodyController, "zmp": ZmpController}
FAR = {"com": [1e300, 0.0, 0.0]}
"""Finite, so that every check of messages lets it pass; its square is not."""

REFERENCES = pytest.mark.parametrize(
    ("controller", "mad", "said"),
    [
        ("whole-body", {"com_acceleration": [1e300, 0.0, 0.0]}, "wrenches"),
        ("whole-body", FAR, "wrenches"),
        ("zmp", {"posture": [1e308] * 28}, "motion"),
    ],
    indirect=["controller"],
)
SENSORS = pytest.mark.parametrize(
    "sensor",
    ["q", "dq", "angular_velocity", "linear_acceleration", "ft_left", "ft_right"],
)


@pytest.fixture(params=LAWS)
def controller(
    request: pytest.FixtureRequest, walker: Robot, snapshot: Snapshot
) -> BalanceController:
    """Return a controller after its calibration, and moving."""
    controller = make_controller(request.param, walker, SETTINGS)
    assert isinstance(controller, LAWS[request.param])
    controller.start(snapshot, walker.nominal)
    assert statuses(controller, [snapshot] * WARM_TICKS) == {OK}
    return controller


def statuses(controller: BalanceController, snapshots: list[Snapshot]) -> set[str]:
    return {controller.step(snapshot).qp_status for snapshot in snapshots}


def commands(outputs: list[ControllerOutput]) -> Array:
    return np.array([output.q_command for output in outputs])


def without_numbers(snapshot: Snapshot, sensor: str) -> Snapshot:
    blank = np.full_like(getattr(snapshot, sensor), np.nan)
    return replace(snapshot, **{sensor: blank})


def reference_with(model: RobotModel, values: dict[str, list[float]]) -> Reference:
    return msgspec.structs.replace(standing_reference(model), **values)


def assert_no_jump(before: Array, after: Array) -> None:
    """Check that no joint's command moves faster than it may."""
    moved = np.diff(np.vstack((before, after)), axis=0)
    assert np.isfinite(moved).all()
    assert np.abs(moved).max() <= FASTEST_STEP_RAD * (1.0 + 1e-9)


def assert_held_and_gone_on_from(
    controller: BalanceController,
    good: tuple[Snapshot, Reference | None],
    bad: tuple[Snapshot, Reference | None],
) -> set[str]:
    """Check that bad ticks hold the posture without a jump; return their statuses."""
    assert controller.failure is None
    before = controller.step(*good).q_command
    outputs = [controller.step(*bad) for _ in range(BAD_TICKS)]
    np.testing.assert_array_equal(
        commands(outputs), np.broadcast_to(before, (BAD_TICKS, before.size))
    )
    after = [controller.step(*good) for _ in range(GOOD_TICKS)]
    assert {output.qp_status for output in after} == {OK}
    assert_no_jump(before, commands(after))
    return {output.qp_status for output in outputs}


@SENSORS
def test_sensor_without_numbers_is_a_status_until_it_is_back(
    controller: BalanceController, snapshot: Snapshot, sensor: str
) -> None:
    blank = without_numbers(snapshot, sensor)
    said = assert_held_and_gone_on_from(controller, (snapshot, None), (blank, None))
    assert OK not in said


@REFERENCES
def test_mad_reference_is_a_status_until_it_is_sane_again(
    controller: BalanceController,
    snapshot: Snapshot,
    mad: dict[str, list[float]],
    said: str,
) -> None:
    sane = standing_reference(controller.model)
    reference = reference_with(controller.model, mad)
    with np.errstate(over="ignore"):
        statuses = assert_held_and_gone_on_from(
            controller, (snapshot, sane), (snapshot, reference)
        )
    assert all(status.startswith(said) for status in statuses)


@pytest.mark.parametrize("controller", ["zmp"], indirect=True)
@pytest.mark.parametrize("mad", [FAR, {"com": [0.0, 0.0, 1e300]}])
def test_mad_reference_that_can_be_solved_gives_no_jump_and_is_forgotten(
    controller: BalanceController, snapshot: Snapshot, mad: dict[str, list[float]]
) -> None:
    sane = standing_reference(controller.model)
    before = controller.step(snapshot).q_command
    references = [reference_with(controller.model, mad), *[sane] * GOOD_TICKS]
    outputs = [controller.step(snapshot, reference) for reference in references]
    assert {output.qp_status for output in outputs} == {OK}
    assert_no_jump(before, commands(outputs))


@REFERENCES
def test_first_failure_is_kept_and_fails_again_on_replay(
    controller: BalanceController,
    snapshot: Snapshot,
    mad: dict[str, list[float]],
    said: str,
) -> None:
    reference = reference_with(controller.model, mad)
    with np.errstate(over="ignore"):
        output = controller.step(snapshot, reference)
    first = controller.failure
    assert first is not None
    statuses = {"tsid": output.wrench_qp, "zmp ik": output.motion_qp}
    assert statuses[first.name] == first.status
    assert output.qp_status.startswith(said)
    with np.errstate(over="ignore"):
        controller.step(snapshot, reference)
    assert controller.failure is first
    sane = standing_reference(controller.model)
    assert controller.step(snapshot, sane).qp_status == OK
    assert filled(first).solve().status == first.status


def test_limits_that_contradict_each_other_are_a_status(
    walker: Robot, snapshot: Snapshot
) -> None:
    """Every foot is to carry more than all that the drives can."""
    heavy = build_settings({}, overrides=["tsid.normal_force_min_n=1e5"])
    controller = WholeBodyController(walker, heavy)
    controller.start(snapshot, walker.nominal)
    outputs = [controller.step(snapshot) for _ in range(WARM_TICKS)]
    assert all(output.qp_status.startswith("wrenches") for output in outputs)
    assert controller.failure is not None
    np.testing.assert_array_equal(
        commands(outputs), np.broadcast_to(walker.nominal, (WARM_TICKS, walker.n_a))
    )


def test_in_the_air_it_goes_on_and_finds_the_ground_again(
    controller: BalanceController, snapshot: Snapshot, model: RobotModel
) -> None:
    """No foot on the ground is no failure; those of the whole-body law come down."""
    airborne = airborne_snapshot(model)
    before = controller.step(snapshot).q_command
    for _ in range(GOOD_TICKS):
        output = controller.step(airborne)
    assert output.qp_status == OK
    assert output.in_contact == (False, False)
    np.testing.assert_array_equal(output.F_id, 0.0)
    if isinstance(controller, WholeBodyController):
        knees = [i for i, name in enumerate(model.robot.joint_names) if "knee" in name]
        assert (output.q_command[knees] < before[knees]).all()
    for _ in range(GOOD_TICKS):
        output = controller.step(snapshot)
    assert output.in_contact == (True, True)
    assert controller.failure is None
