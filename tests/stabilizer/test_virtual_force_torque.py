"""Ankle wrenches without ankle sensors, compared with model and simulator."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pinocchio as pin
import pytest

import surefoot as sf
from surefoot.robot_io.identity import describe
from surefoot.robot_io.robot import Robot, make_robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.reasons import Outcome, SensorTrouble, StabilizerState
from surefoot.schemas.robot_file import VirtualForceTorque
from surefoot.schemas.settings import SafetySettings
from surefoot.stabilizer.estimation.wrenches import (
    ForceOffsets,
    VirtualWrenches,
)
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.safety.safety import Safety
from tests.awkward_robot import Awkward
from tests.stabilizer.closed_loop import NOISE, swing
from tests.stabilizer.watched_run import watched_run

PERIOD_S = 1e-3
QUICK = VirtualForceTorque(cutoff_hz=150.0)
SETTLED = 60
MOST_SHARE = 0.02
"""Error over the largest force or moment: lag of the observer and the prior."""
MOST_FORCE_N, MOST_MOMENT_NM = 4.0, 0.6
MOST_AT_REST_N = 1.0


class Course:
    """A robot whose base turns and shakes and whose joints swing, analytically."""

    def __init__(self, model: RobotModel, seed: int) -> None:
        self.model, self.pin = model, model.pin_model
        self.data = self.pin.createData()
        rng = np.random.default_rng(seed)
        self.size = np.concatenate(
            ([0.2, 0.2, 0.3, 0.4, 0.4, 0.4], rng.uniform(0.1, 0.4, model.n_a))
        )
        self.rate = rng.uniform(4.0, 12.0, model.n_v)
        self.F = rng.normal(size=(2, 6)) * ([150.0] * 3 + [15.0] * 3)
        self.F[:, 2] += 350.0
        self.q = model.nominal_configuration()

    def tick(self, k: int) -> tuple[Snapshot, Array]:
        """Return the sensors at a tick, and the true wrenches at the ankles."""
        t = k * PERIOD_S
        v = self.size * np.sin(self.rate * t)
        a = self.size * self.rate * np.cos(self.rate * t)
        if k:
            self.q = pin.integrate(self.pin, self.q, v * PERIOD_S)
        model, data = self.model, self.data
        pin.forwardKinematics(self.pin, data, self.q, v, a)
        pin.updateFramePlacements(self.pin, data)
        outside = pin.StdVec_Force()
        for _ in range(self.pin.njoints):
            outside.append(pin.Force.Zero())
        for sole_id, F in zip(model.sole_ids, self.F, strict=True):
            frame = self.pin.frames[sole_id]
            outside[frame.parentJoint] += frame.placement.act(pin.Force(F))
        tau = pin.rnea(self.pin, data, self.q, v, a, outside)
        effort = tau[6:] + model.robot.damping[model.to_model] * v[6:]
        imu = pin.Frame(
            "unit", 1, 0, model.T_base_imu, pin.FrameType.OP_FRAME, pin.Inertia.Zero()
        )
        rotation = data.oMi[1].rotation @ imu.placement.rotation
        lever = imu.placement.translation
        w, dw = v[3:6], a[3:6]
        # The base's own acceleration is that of its twist and what turning adds.
        felt = a[:3] + np.cross(w, v[:3]) + np.cross(dw, lever)
        felt = felt + np.cross(w, np.cross(w, lever))
        force = imu.placement.rotation.T @ felt - rotation.T @ self.pin.gravity.linear
        snapshot = Snapshot(
            tick=k,
            stamp_ns=k * 1_000_000,
            q=self.q[7:][model.to_bus],
            dq=v[6:][model.to_bus],
            effort=effort[model.to_bus],
            quat_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
            angular_velocity=imu.placement.rotation.T @ w,
            linear_acceleration=force,
            ft_left=np.zeros(6),
            ft_right=np.zeros(6),
        )
        return snapshot, np.concatenate([self._felt(i) for i in (0, 1)])

    def _felt(self, side: int) -> Array:
        """Return the wrench at the sensor: the ground's minus what moves the plate."""
        sensor_id = self.pin.getFrameId(self.model.robot.file.foot[side].ft_link)
        sensor = self.pin.frames[sensor_id]
        mount = sensor.parentFrame
        ground = self.model.T_sensor_sole[side].act(pin.Force(self.F[side]))
        acceleration = self.data.a[sensor.parentJoint].copy()
        rotation = self.data.oMi[sensor.parentJoint].rotation
        acceleration.linear -= rotation.T @ self.pin.gravity.linear
        speed = self.data.v[sensor.parentJoint]
        wrench = pin.Force.Zero()
        for frame in self.pin.frames:
            if frame.inertia.mass > 0.0 and self._is_below(frame, mount):
                inertia = frame.inertia.se3Action(frame.placement)
                wrench += inertia * acceleration + speed.cross(inertia * speed)
        return (ground - sensor.placement.actInv(wrench)).vector

    def _is_below(self, frame: pin.Frame, mount: int) -> bool:
        while True:
            here = self.pin.getFrameId(frame.name)
            if here in (0, mount):
                return bool(here == mount)
            frame = self.pin.frames[frame.parentFrame]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("is_awkward", [False, True])
def test_it_feels_what_a_sensor_would_while_everything_moves(
    walker: Robot, awkward: Awkward, is_awkward: bool, seed: int
) -> None:
    model = RobotModel(awkward.robot if is_awkward else walker)
    course = Course(model, seed)
    virtual = VirtualWrenches(model, QUICK, period_s=PERIOD_S)
    worst = np.zeros(12)
    for k in range(3 * SETTLED):
        snapshot, felt = course.tick(k)
        found = virtual.infer(snapshot)
        if k >= SETTLED:
            error = np.concatenate((found.ft_left, found.ft_right)) - felt
            worst = np.maximum(worst, np.abs(error))
    forces = [0, 1, 2, 6, 7, 8]
    moments = [3, 4, 5, 9, 10, 11]
    assert worst[forces].max() < MOST_SHARE * np.abs(felt[forces]).max()
    assert worst[moments].max() < 3.0 * MOST_SHARE * np.abs(felt[moments]).max()


@pytest.mark.parametrize("link", ["foot_plate", "foot"])
def test_what_hangs_below_the_sensor_is_not_taken_for_ground(
    walker: Robot, link: str
) -> None:
    """Whether the sensor's link is fixed to the foot, or an ankle joint carries it."""
    feet = [
        msgspec.structs.replace(foot, ft_link=f"{foot.side}_{link}")
        for foot in walker.file.foot
    ]
    file = msgspec.structs.replace(walker.file, foot=feet)
    model = RobotModel(make_robot(file, path=walker.path, urdf_path=walker.urdf_path))
    course = Course(model, 0)
    course.size[:] = 0.0
    course.F = np.tile([0.0, 0.0, 350.0, 0.0, 0.0, 0.0], (2, 1))
    snapshot, _ = course.tick(0)
    found = VirtualWrenches(model, QUICK, period_s=PERIOD_S).infer(snapshot)
    for plate, ft in zip(model.plates, (found.ft_left, found.ft_right), strict=True):
        felt = ft[2] + plate.mass * GRAVITY
        assert felt == pytest.approx(350.0, abs=MOST_AT_REST_N)


def test_a_reading_that_is_no_number_costs_one_tick(walker: Robot) -> None:
    model = RobotModel(walker)
    course = Course(model, 0)
    virtual = VirtualWrenches(model, QUICK, period_s=PERIOD_S)
    for k in range(3 * SETTLED):
        snapshot, felt = course.tick(k)
        if k == SETTLED:
            snapshot = replace(snapshot, effort=np.full(walker.n_a, np.nan))
        found = virtual.infer(snapshot)
        assert bool(np.isfinite(found.ft_left).all()) is (k != SETTLED)
    assert np.abs(found.ft_left - felt[:6]).max() < MOST_SHARE * felt.max()


OFF = np.array([-220.0, 200.0, 0.0, 0.0, 0.0, 0.0])


def corrected(
    walker: Robot,
    *,
    off: Array,
    effort: float = 1.0,
    ticks: int = 600,
    lasts: tuple[int, int] = (0, 600),
) -> tuple[Array, bool]:
    """Return the left sensor's error at the end, and whether it was reported."""
    model = RobotModel(walker)
    course, offsets = Course(model, 0), ForceOffsets(model)
    for k in range(ticks):
        snapshot, felt = course.tick(k)
        reading = replace(
            snapshot,
            effort=effort * snapshot.effort,
            ft_left=felt[:6] + off * (lasts[0] <= k < lasts[1]),
            ft_right=felt[6:],
        )
        seen = offsets.correct(reading)
    assert np.array_equal(seen.ft_right, felt[6:])
    return seen.ft_left - felt[:6], offsets.found[0]


def test_a_force_along_the_sole_that_no_joint_feels_is_taken_off(walker: Robot) -> None:
    error, is_off = corrected(walker, off=OFF)
    assert is_off
    assert np.linalg.norm(error) < 0.2 * np.linalg.norm(OFF)


@pytest.mark.parametrize(("length", "is_told"), [(300, True), (90, False)])
def test_one_that_comes_suddenly_is_told_from_an_impact_by_its_length(
    walker: Robot, length: int, is_told: bool
) -> None:
    """Averaged over a second, the foot had yielded for half of it."""
    off, ends = np.array([0.0, 260.0, 0.0, 0.0, 0.0, 0.0]), 2000 + length
    error, is_off = corrected(walker, off=off, ticks=ends, lasts=(2000, ends))
    assert is_off is is_told
    left = np.linalg.norm(error) / np.linalg.norm(off)
    assert left < 0.2 if is_told else left == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("off", "effort"), [(0.0, 1.0), (0.3, 1.0), (1.0, 0.0), (1.0, -1.0), (0.0, 2.0)]
)
def test_what_is_small_or_told_by_efforts_that_explain_nothing_stays(
    walker: Robot, off: float, effort: float
) -> None:
    error, is_off = corrected(walker, off=off * OFF, effort=effort)
    assert not is_off
    np.testing.assert_allclose(error, off * OFF, atol=1e-9)


@pytest.mark.closed_loop
def test_two_feet_do_not_fight_what_a_sensor_invents(walker: Robot) -> None:
    run = watched_run(
        walker,
        duration_s=5.0,
        platform=[{"foot": "both", "motion": [swing("roll", 8.0, 0.35, start_s=1.0)]}],
        sensors={**NOISE, "force_bias_n": {"left": [300.0, 0.0, 0.0]}},
    )
    assert run.losses == {"left_ankle_ft": SensorTrouble.OFFSET}
    assert not run.fell
    assert run.com_error_max_mm is not None
    assert max(run.com_error_max_mm[:2]) < 20.0


@pytest.mark.closed_loop
def test_a_sudden_false_force_along_the_sole_costs_no_sensor(walker: Robot) -> None:
    """Its moment about the sole presses far outside of it."""
    false = {"sensor": "left_ankle_ft", "kind": "jump", "part": "force", "axis": "y"}
    times = {"start_s": 0.6, "duration_s": 5.0}
    run = watched_run(walker, duration_s=2.0, fault=[{**false, **times, "size": 300.0}])
    assert run.losses == {"left_ankle_ft": SensorTrouble.OFFSET}
    assert run.states == [StabilizerState.ACTIVE]
    assert run.com_error_max_mm is not None
    assert max(run.com_error_max_mm) < 20.0


def without_sensors(robot: Robot, **settings: float) -> Robot:
    virtual = VirtualForceTorque(**settings)
    return replace(robot, file=msgspec.structs.replace(robot.file, virtual_ft=virtual))


@pytest.mark.closed_loop
def test_the_walker_balances_on_fast_ground_without_ankle_sensors() -> None:
    robot = without_sensors(sf.load_robot("walker"), effort_noise_nm=0.2)
    scenario = sf.load_scenario("moving-platform-fast")
    scenario = msgspec.structs.replace(scenario, duration_s=2.5)
    run = sf.simulate(robot, scenario, controller="whole-body", seed=1)
    assert run.outcome is Outcome.STOOD
    signals = run.signals
    assert not np.any(signals["ft_left"])  # what the robot says: it has no sensor
    error = (signals["F_meas"] - signals["true_F"])[signals["time_s"] > 0.5]
    rms = np.sqrt(np.mean(error**2, axis=0))
    assert rms[[0, 1, 2, 6, 7, 8]].max() < MOST_FORCE_N
    assert rms[[3, 4, 5, 9, 10, 11]].max() < MOST_MOMENT_NM
    assert np.max(run.result.com_error_max_mm) < 15.0


def test_efforts_that_are_not_measured_are_a_lost_sensor() -> None:
    robot = without_sensors(sf.load_robot("walker"))
    model = RobotModel(robot)
    snapshot, _ = Course(model, 0).tick(0)
    silent = replace(snapshot, effort=np.zeros(robot.n_a))
    safety = Safety(sf.make_controller("whole-body", robot), robot, SafetySettings())
    safety.start(silent, robot.nominal)
    for tick in range(50):
        force = np.array([0.0, 0.0, 9.81 + 1e-6 * tick])
        later = replace(silent, tick=tick, linear_acceleration=force)
        safety.step(later, (0, 0, 0, 0))
    assert set(safety.losses) == {"left_ankle_ft", "right_ankle_ft"}
    assert "left_ankle_ft (virtual)" in safety.detail


def test_who_expects_sensors_is_another_robot() -> None:
    robot = sf.load_robot("walker")
    assert describe(without_sensors(robot)) != describe(robot)
