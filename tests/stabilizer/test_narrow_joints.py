"""A joint that can hardly move, or not at all, stops no other."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot, make_robot
from surefoot.schemas.law_settings import DikSettings
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.stabilizer.dynamics import NORMAL, Dynamics
from surefoot.stabilizer.factory import check_settings, make_controller
from surefoot.stabilizer.margins.margins import compute_margins
from surefoot.stabilizer.model import N_BASE_V, RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import run_closed_loop, swing
from tests.stabilizer.laws import PAPER, answer, make_law
from tests.stabilizer.rig import Rig
from tests.stabilizer.states import nominal_state

PUSH = {"body": "torso", "force_n": [0.0, 90.0, 0.0], "start_s": 0.8}
MOTION = swing("roll", 3.0, 0.7)
LEAST_RANGE_RAD = 1e-12
"""Range of a locked joint in floating point."""
SEEN_TICKS, SWAYS_N = 300, 10.0
"""Last ticks of a run, and normal force variation there that counts as sway."""


def limited(walker: Robot, names: tuple[str, ...], half_rad: float) -> Robot:
    """Return the Walker with some joints limited to half a range to either side."""
    joints = [
        msgspec.structs.replace(
            joint,
            soft_lower_rad=joint.nominal_rad - half_rad,
            soft_upper_rad=joint.nominal_rad + half_rad,
        )
        if joint.name in names
        else joint
        for joint in walker.file.joint
    ]
    file = msgspec.structs.replace(walker.file, joint=joints)
    return make_robot(file, path=walker.path, urdf_path=walker.urdf_path)


@pytest.mark.closed_loop
@pytest.mark.usual("whole-body-0.0-names0", "zmp-0.005-names2")
@pytest.mark.parametrize(
    ("controller", "half_rad", "names"),
    [
        ("whole-body", 0.0, ("right_ankle_roll",)),
        ("whole-body", 0.005, ("left_hip_yaw", "right_shoulder_roll")),
        ("zmp", 0.005, ("right_ankle_roll",)),
    ],
)
def test_it_balances_without_them(
    walker: Robot, controller: str, half_rad: float, names: tuple[str, ...]
) -> None:
    robot = limited(walker, names, half_rad)
    check_settings(ControllerSettings(), robot)
    run = run_closed_loop(
        robot,
        controller=make_controller(controller, robot, ControllerSettings()),
        duration_s=1.5,
        push=[{**PUSH, "duration_s": 0.1}],
        platform=[{"foot": "both", "motion": [MOTION]}],
    )
    assert run.statuses == {"ok"}
    assert not run.fell
    at = [robot.joint_names.index(name) for name in names]
    moved = np.abs(run.commands[:, at] - robot.nominal[at]).max()
    assert moved <= half_rad + LEAST_RANGE_RAD


@pytest.mark.parametrize("half_rad", [0.0, 0.005])
def test_the_soles_are_asked_for_nothing_that_takes_them(
    walker: Robot, half_rad: float
) -> None:
    """Else the second QP moves them otherwise: with hip yaw locked the G1 fell."""
    names = ("left_hip_yaw", "right_hip_yaw")
    model = RobotModel(limited(walker, names, half_rad))
    rig, law = Rig(model, PAPER), make_law(PAPER)
    rig.go(nominal_state(model))
    at = [N_BASE_V + list(model.pin_model.names).index(name) - 2 for name in names]
    J = np.delete(rig.dynamics.J_contact, at, axis=1)
    rng = np.random.default_rng(5)
    for _ in range(5):
        r = answer(law, rig, rng.normal(size=12))
        asked = J @ np.linalg.lstsq(J, r, rcond=1e-9)[0]
        np.testing.assert_allclose(asked, r, atol=1e-9)


def test_soles_yield_as_if_the_joints_above_the_legs_were_held_as_well(
    walker: Robot,
) -> None:
    """Else the second QP swings the trunk for them: so the G1 swayed by its waist."""
    model = RobotModel(limited(walker, ("left_hip_yaw",), 0.005))
    dynamics = Dynamics(model)
    dynamics.update(model.nominal_configuration(), np.zeros(model.n_v))
    moving = np.flatnonzero(
        np.concatenate((np.ones(N_BASE_V, bool), model.is_leg & ~model.is_narrow))
    )
    H, J = dynamics.inertia_matrix(), dynamics.J_contact[:, moving]
    expected = J @ np.linalg.solve(H[np.ix_(moving, moving)], J.T)
    np.testing.assert_allclose(dynamics.mobility, expected, atol=1e-9)


@pytest.mark.closed_loop
@pytest.mark.parametrize(("softer", "is_calm"), [(18.0, True), (23.0, False)])
def test_with_locked_knees_it_begins_to_sway_where_its_margins_say(
    walker: Robot, softer: float, is_calm: bool
) -> None:
    """Along z, 20 times softer than the default; it is 6 with knees that move."""
    robot = limited(walker, ("left_knee", "right_knee"), 0.0)
    gains = list(DikSettings().k_force)
    gains[NORMAL] /= softer
    settings = build_settings({}, overrides=[f"dik.k_force={gains}"])
    assert compute_margins(robot, settings).stable is is_calm
    run = run_closed_loop(
        robot, controller=WholeBodyController(robot, settings), duration_s=1.0
    )
    pushed = run.F_meas[-SEEN_TICKS:, NORMAL]
    assert bool(np.std(pushed) < SWAYS_N) is is_calm


def test_a_joint_that_stands_at_an_end_of_its_range_leaves_margins_as_they_are(
    walker: Robot,
) -> None:
    joints = [
        msgspec.structs.replace(joint, soft_upper_rad=joint.nominal_rad)
        if joint.name == "left_knee"
        else joint
        for joint in walker.file.joint
    ]
    file = msgspec.structs.replace(walker.file, joint=joints)
    robot = make_robot(file, path=walker.path, urdf_path=walker.urdf_path)
    assert compute_margins(robot, ControllerSettings()) == compute_margins(
        walker, ControllerSettings()
    )


def test_margins_leave_half_of_every_range(walker: Robot) -> None:
    robot = limited(walker, ("left_elbow",), 0.005)
    model = RobotModel(robot)
    lower, upper = model.range_within(DikSettings().limit_margin_rad)
    assert (upper - lower >= 0.5 * (model.upper - model.lower) - LEAST_RANGE_RAD).all()
    wide = model.upper - model.lower > 0.1
    np.testing.assert_array_equal(
        lower[wide], model.lower[wide] + DikSettings().limit_margin_rad
    )
