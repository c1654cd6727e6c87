"""The static model: joint orders, frames, nominal stance."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.model import GRAVITY, RobotModel, skew

TOLERANCE = 1e-12


def test_joints_keep_their_names_on_the_way(walker: Robot, model: RobotModel) -> None:
    in_model = list(model.pin_model.names)[2:]
    assert [walker.joint_names[i] for i in model.to_model] == in_model
    assert [in_model[i] for i in model.to_bus] == walker.joint_names


def test_limits_are_those_of_the_named_joints(walker: Robot, model: RobotModel) -> None:
    for in_model, on_bus in (
        (model.lower, walker.soft_lower),
        (model.upper, walker.soft_upper),
        (model.torque_limit, walker.torque_limit),
        (model.velocity_limit, walker.velocity_limit),
        (model.nominal, walker.nominal),
    ):
        np.testing.assert_array_equal(in_model[model.to_bus], on_bus)


def test_legs_are_what_carries_the_robot(walker: Robot, model: RobotModel) -> None:
    names = list(model.pin_model.names)[2:]
    legs = {name for name, leg in zip(names, model.is_leg, strict=True) if leg}
    kinds = ("hip", "knee", "ankle")
    assert legs == {n for n in walker.joint_names if any(kind in n for kind in kinds)}


def test_nominal_soles_are_level_and_around_the_origin(model: RobotModel) -> None:
    data = model.pin_model.createData()
    pin.framesForwardKinematics(model.pin_model, data, model.nominal_configuration())
    left, right = (data.oMf[frame] for frame in model.sole_ids)
    np.testing.assert_allclose(left.translation, -right.translation, atol=TOLERANCE)
    assert left.translation[1] > 0.0
    for sole in (left, right):
        assert sole.translation[2] == pytest.approx(0.0, abs=TOLERANCE)
        np.testing.assert_allclose(sole.rotation, np.eye(3), atol=TOLERANCE)


def test_standing_reference_is_the_nominal_stance(model: RobotModel) -> None:
    stance, data = standing(model), model.pin_model.createData()
    q = model.nominal_configuration()
    com = pin.centerOfMass(model.pin_model, data, q)
    np.testing.assert_allclose(stance.com, com, atol=TOLERANCE)
    # Over the soles, or the robot could not stand there.
    reach = min(foot.half_length_m for foot in model.robot.file.foot)
    assert np.abs(stance.com[:2]).max() < 0.5 * reach


def test_mass_is_that_of_all_links_under_the_simulators_gravity(
    model: RobotModel,
) -> None:
    links = sum(float(inertia.mass) for inertia in model.pin_model.inertias)
    assert model.mass == pytest.approx(links)
    np.testing.assert_array_equal(model.pin_model.gravity.linear, [0.0, 0.0, -GRAVITY])


def test_robot_file_that_lists_other_joints_is_refused(walker: Robot) -> None:
    fewer = msgspec.structs.replace(walker.file, joint=walker.file.joint[:-1])
    with pytest.raises(ValueError, match=r"28 joint velocities.*lists 27"):
        RobotModel(replace(walker, file=fewer))


def test_skew_is_the_cross_product() -> None:
    a, b = np.random.default_rng(31).normal(size=(2, 3))
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=TOLERANCE)
