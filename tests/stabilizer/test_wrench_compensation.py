"""The ground's wrench at the sole, from the reading of the ankle's sensor."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat, Vec6
from surefoot.stabilizer.estimation.wrenches import WrenchCompensation
from surefoot.stabilizer.model import GRAVITY, RobotModel

SAMPLES = 50
FORCE_SPREAD = 300.0
TOLERANCE = 1e-9


@pytest.fixture
def compensation(model: RobotModel) -> WrenchCompensation:
    return WrenchCompensation(model)


def random_rotation(rng: np.random.Generator) -> Mat:
    quat = rng.normal(size=4)
    rotation: Mat = pin.Quaternion(quat / np.linalg.norm(quat)).toRotationMatrix()
    return rotation


def felt_by_the_sensor(
    model: RobotModel, F_ground: Vec6, *, R_world_sole: Mat, side: int
) -> Vec6:
    """Return the sensor's wrench for a plate at rest, about the sensor's origin.

    By Newton and Euler the plate passes on what acts on it: ground and weight.
    """
    T_sensor_sole, plate = model.T_sensor_sole[side], model.plates[side]
    R_world_sensor = R_world_sole @ T_sensor_sole.rotation.T
    ground_force = T_sensor_sole.rotation @ F_ground[:3]
    ground_moment = T_sensor_sole.rotation @ F_ground[3:]
    weight = R_world_sensor.T @ np.array([0.0, 0.0, -plate.mass * GRAVITY])
    force = ground_force + weight
    moment = (
        ground_moment
        + np.cross(T_sensor_sole.translation, ground_force)
        + np.cross(plate.com, weight)
    )
    return np.concatenate((force, moment))


def test_plate_at_rest_gives_back_the_ground_wrench(
    model: RobotModel, compensation: WrenchCompensation
) -> None:
    rng = np.random.default_rng(5)
    for _ in range(SAMPLES):
        F = FORCE_SPREAD * rng.normal(size=12)
        rotations = [random_rotation(rng), random_rotation(rng)]
        left, right = (
            felt_by_the_sensor(model, wrench, R_world_sole=R, side=side)
            for side, (wrench, R) in enumerate(
                zip(F.reshape(2, 6), rotations, strict=True)
            )
        )
        F_meas = compensation.update(left, right, rotations)
        np.testing.assert_allclose(F_meas, F, atol=TOLERANCE)


def test_foot_in_the_air_feels_no_ground(
    model: RobotModel, compensation: WrenchCompensation
) -> None:
    level = [np.eye(3), np.eye(3)]
    hanging = [
        felt_by_the_sensor(model, np.zeros(6), R_world_sole=np.eye(3), side=side)
        for side in (0, 1)
    ]
    assert hanging[0][2] == pytest.approx(-model.plates[0].mass * GRAVITY)
    F_meas = compensation.update(hanging[0], hanging[1], level)
    np.testing.assert_allclose(F_meas, np.zeros(12), atol=TOLERANCE)


def test_one_foot_does_not_change_the_other(
    compensation: WrenchCompensation,
) -> None:
    rng = np.random.default_rng(6)
    rotations = [random_rotation(rng), random_rotation(rng)]
    left, right, other = rng.normal(size=(3, 6))
    before = compensation.update(left, right, rotations).copy()
    after = compensation.update(left, other, rotations)
    np.testing.assert_array_equal(after[:6], before[:6])
    assert not np.array_equal(after[6:], before[6:])


def links_below(urdf: ET.Element, top: str) -> dict[str, Array]:
    """Return links fixed below a link, with their frames' places in it (3,) [m]."""
    below = {top: np.zeros(3)}
    for joint in urdf.findall("joint"):
        parent, child, origin = (
            joint.find(tag) for tag in ("parent", "child", "origin")
        )
        assert parent is not None
        assert child is not None
        if str(parent.get("link")) in below:
            assert joint.get("type") == "fixed"
            assert origin is not None
            assert origin.get("rpy", "0 0 0") == "0 0 0"
            place = below[str(parent.get("link"))] + vector(origin.get("xyz"))
            below[str(child.get("link"))] = place
    return below


def vector(text: str | None) -> Array:
    return np.array([float(number) for number in str(text).split()])


def test_plate_is_all_that_hangs_below_the_sensor(
    walker: Robot, model: RobotModel
) -> None:
    """Mass and centre of mass, from the URDF's own tree of fixed links."""
    urdf = ET.parse(walker.urdf_path).getroot()
    links = {str(link.get("name")): link for link in urdf.findall("link")}
    for foot, plate in zip(walker.file.foot, model.plates, strict=True):
        mass, moment = 0.0, np.zeros(3)
        for name, place in links_below(urdf, foot.ft_link).items():
            of_link = links[name].find("inertial/mass")
            origin = links[name].find("inertial/origin")
            if of_link is not None and origin is not None:
                value = float(str(of_link.get("value")))
                mass += value
                moment += value * (place + vector(origin.get("xyz")))
        assert plate.mass == pytest.approx(mass)
        assert plate.mass > 0.0
        np.testing.assert_allclose(plate.com, moment / mass, atol=TOLERANCE)
