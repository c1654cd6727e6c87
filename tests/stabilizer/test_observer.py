"""The observer with every controller, and with a custom estimator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import SensorTrouble
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.estimation.observer import Observer
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from surefoot.stabilizer.zmp.controller import ZmpController
from tests.stabilizer.closed_loop import ROLLING, Run, run_closed_loop
from tests.stabilizer.standing_snapshot import airborne_snapshot

PERIOD_S = 0.001
CALIBRATION_TICKS = 20
SETTINGS = build_settings({}, overrides=["estimator.calibration_s=0.0205"])
"""The calibration ends between two ticks, so that rounding does not matter."""
SENSORS = ["q", "dq", "angular_velocity", "linear_acceleration", "ft_left", "ft_right"]
CONTROLLERS = pytest.mark.parametrize("make", [WholeBodyController, ZmpController])
EXACT_N = 1e-9


def make_observer(model: RobotModel, settings: ControllerSettings) -> Observer:
    return Observer(
        model, settings, Dynamics(model), largest_force=1e3, period_s=PERIOD_S
    )


@pytest.fixture
def observer(model: RobotModel, snapshot: Snapshot) -> Observer:
    """Return an observer that has started."""
    observer = make_observer(model, SETTINGS)
    observer.start(snapshot)
    return observer


@pytest.fixture(scope="module")
def moving_run(walker: Robot) -> Run:
    return run_closed_loop(walker, duration_s=0.8, platform=ROLLING)


@CONTROLLERS
def test_every_controller_sees_what_an_observer_alone_sees(
    walker: Robot,
    model: RobotModel,
    moving_run: Run,
    make: Callable[[Robot, ControllerSettings], WholeBodyController | ZmpController],
) -> None:
    controller = make(walker, ControllerSettings())
    observer = make_observer(model, ControllerSettings())
    controller.start(moving_run.snapshots[0], walker.nominal)
    observer.start(moving_run.snapshots[0])
    for snapshot in moving_run.snapshots:
        output, state = controller.step(snapshot), observer.update(snapshot)
        assert state is not None
        assert output.in_contact == tuple(state.in_contact)
        np.testing.assert_array_equal(output.base_pose, state.q[:7])
        np.testing.assert_array_equal(output.base_twist, state.v[:6])
        np.testing.assert_array_equal(output.F_meas, state.F_meas)


class SureEstimator:
    """An estimator that ignores the sensors; notes what it is told."""

    def __init__(self, model: RobotModel) -> None:
        self.q: Array = model.nominal_configuration()
        self.v: Array = np.zeros(model.n_v)
        self.R_world_base = np.eye(3)
        self.ground_height = 0.0
        self.calibrations = 0
        self.told: list[Array | None] = []

    def calibrate(self, snapshot: Snapshot, *, wrenches: Array | None) -> None:
        self.calibrations += 1

    def update(self, snapshot: Snapshot, *, wrenches: Array | None) -> None:
        self.told.append(None if wrenches is None else wrenches.copy())
        # A new array every time, as an estimator may do.
        self.q = self.q.copy()
        self.q[0] = 0.001 * len(self.told)
        self.ground_height = -self.q[0]


class WrappedEstimator:
    """An estimator that has all that the project's own has, and is none of it."""

    def __init__(self, inner: Estimator) -> None:
        self.inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


@CONTROLLERS
def test_all_of_an_estimator_from_outside_is_used(
    walker: Robot,
    model: RobotModel,
    moving_run: Run,
    make: Callable[..., WholeBodyController | ZmpController],
) -> None:
    own = make(walker, SETTINGS)
    inner = Estimator(model, SETTINGS.estimator, period_s=PERIOD_S)
    wrapped = make(walker, SETTINGS, estimator=WrappedEstimator(inner))
    first, *others = moving_run.snapshots
    for controller in (own, wrapped):
        controller.start(first, walker.nominal)
    assert wrapped.observer.anchors is not None
    for count, snapshot in enumerate(others):
        if count % 5 == 4:
            own.pass_over(snapshot)
            wrapped.pass_over(snapshot)
            continue
        q_command = own.step(snapshot).q_command
        np.testing.assert_array_equal(q_command, wrapped.step(snapshot).q_command)
    seen = wrapped.observer.state.ground_acceleration
    assert seen is inner.ground_acceleration


@pytest.mark.parametrize(
    ("name", "value", "trouble"),
    [
        ("doubt", "it is off", (SensorTrouble.INCONSISTENT, "it is off")),
        ("gyro_is_off", True, (SensorTrouble.OFFSET, "")),
    ],
)
def test_what_an_estimator_from_outside_doubts_is_told(
    model: RobotModel, snapshot: Snapshot, name: str, value: object, trouble: object
) -> None:
    estimator = SureEstimator(model)
    observer = Observer(
        model,
        SETTINGS,
        Dynamics(model),
        largest_force=1e3,
        period_s=PERIOD_S,
        estimator=estimator,
    )
    observer.start(snapshot)
    assert observer.imu_trouble == (None, "")
    setattr(estimator, name, value)
    for _ in range(CALIBRATION_TICKS + 1):
        observer.update(snapshot)
    assert observer.imu_trouble == trouble


@CONTROLLERS
def test_estimator_from_outside_is_believed(
    walker: Robot,
    model: RobotModel,
    snapshot: Snapshot,
    make: Callable[..., WholeBodyController | ZmpController],
) -> None:
    estimator = SureEstimator(model)
    controller = make(walker, SETTINGS, estimator=estimator)
    controller.start(snapshot, walker.nominal)
    outputs: list[ControllerOutput] = [
        controller.step(snapshot) for _ in range(CALIBRATION_TICKS + 3)
    ]
    assert estimator.calibrations == 1 + CALIBRATION_TICKS
    assert len(estimator.told) == 3
    half = 0.5 * model.mass * GRAVITY
    for wrenches in estimator.told:
        assert wrenches is not None
        np.testing.assert_allclose(wrenches[[2, 8]], half, rtol=1e-6)
    assert [output.base_pose[0] for output in outputs[-3:]] == [0.001, 0.002, 0.003]
    state = controller.observer.state
    assert state.q is estimator.q
    assert state.ground_height == -0.003
    com = outputs[-1].com
    assert com is not None
    shift = 0.003 - model.nominal_configuration()[0]
    assert com[0] == pytest.approx(standing(model).com[0] + shift)


def test_calibration_lasts_as_long_as_it_should(
    observer: Observer, snapshot: Snapshot
) -> None:
    phases = []
    for _ in range(CALIBRATION_TICKS + 2):
        state = observer.update(snapshot)
        assert state is not None
        assert state.is_calibrating == (state.active_s < 0.0)
        phases.append(state.is_calibrating)
    assert phases == [True] * CALIBRATION_TICKS + [False] * 2
    assert state.active_s == pytest.approx(PERIOD_S * (CALIBRATION_TICKS + 2) - 0.0205)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("nonsense", [np.nan, np.inf, -np.inf])
def test_sensor_without_numbers_changes_nothing(
    model: RobotModel, snapshot: Snapshot, sensor: str, nonsense: float
) -> None:
    scarred, fresh = make_observer(model, SETTINGS), make_observer(model, SETTINGS)
    values = getattr(snapshot, sensor).copy()
    values[-1] = nonsense
    blank = replace(snapshot, **{sensor: values})
    for each in (scarred, fresh):
        each.start(snapshot)
    for _ in range(2 * CALIBRATION_TICKS):
        assert scarred.update(blank) is None
        after, expected = scarred.update(snapshot), fresh.update(snapshot)
        assert after is not None
        assert expected is not None
        for name in ("q", "v", "R_world_base", "F_meas", "allowed", "active_s"):
            np.testing.assert_array_equal(getattr(after, name), getattr(expected, name))


def test_contacts_are_those_of_the_measured_forces(
    model: RobotModel, observer: Observer, snapshot: Snapshot
) -> None:
    for reading, stands in ((snapshot, True), (airborne_snapshot(model), False)):
        for _ in range(2 * CALIBRATION_TICKS):
            state = observer.update(reading)
        assert state is not None
        assert state.in_contact == [stands, stands]
        assert state.allowed.tolist() == [1e3 * stands] * 2


@pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])
def test_foot_without_sensor_feels_what_it_should_and_carries_the_rest(
    model: RobotModel, observer: Observer, snapshot: Snapshot, side: int
) -> None:
    wanted = np.arange(1.0, 13.0)
    seen = observer.update(snapshot)
    assert seen is not None
    measured = seen.F_meas.copy()
    lost = (side == 0, side == 1)
    observer.leave_out(lost, instead=wanted)
    state = observer.update(snapshot)
    assert state is not None
    rows, others = (slice(0, 6), slice(6, 12))[:: 1 if side == 0 else -1]
    expected = wanted[rows].copy()
    expected[2] = model.mass * GRAVITY - measured[others][2]
    np.testing.assert_allclose(state.F_meas[rows], expected, atol=EXACT_N)
    np.testing.assert_allclose(state.F_meas[others], measured[others], atol=EXACT_N)
    # Once the wanted wrenches are known, it feels just those: no error.
    wanted += 5.0
    observer.assume_wanted()
    np.testing.assert_array_equal(state.F_meas[rows], wanted[rows])
    np.testing.assert_allclose(state.F_meas[others], measured[others], atol=EXACT_N)


def test_without_both_sensors_both_feel_what_they_should(
    observer: Observer, snapshot: Snapshot
) -> None:
    wanted = np.arange(1.0, 13.0)
    observer.leave_out((True, True), instead=wanted)
    state = observer.update(snapshot)
    assert state is not None
    np.testing.assert_array_equal(state.F_meas, wanted)


def test_sensor_that_is_back_is_believed_again(
    observer: Observer, snapshot: Snapshot
) -> None:
    before = observer.update(snapshot)
    assert before is not None
    measured = before.F_meas.copy()
    observer.leave_out((True, False), instead=np.zeros(12))
    observer.update(snapshot)
    observer.leave_out((False, False), instead=np.zeros(12))
    state = observer.update(snapshot)
    assert state is not None
    np.testing.assert_allclose(state.F_meas, measured, atol=EXACT_N)
