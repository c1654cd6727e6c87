"""The controller follows a planner's references."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.messages import FootReference, Reference
from surefoot.stabilizer.control.reference import (
    Approach,
    ReferenceLimits,
    Stance,
    standing,
)
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.kinematic_robot import joint_offsets
from tests.stabilizer.standing_snapshot import standing_reference

TOLERANCE = 1e-12
SAMPLES = 20


@pytest.fixture
def stance(model: RobotModel) -> Stance:
    return standing(model)


def random_quaternion(rng: np.random.Generator) -> pin.Quaternion:
    xyzw = rng.normal(size=4)
    return pin.Quaternion(xyzw / np.linalg.norm(xyzw))


def yawed(position: list[float], yaw: float) -> FootReference:
    half = 0.5 * yaw
    return FootReference(position, [0.0, 0.0, float(np.sin(half)), float(np.cos(half))])


@pytest.fixture
def reference(model: RobotModel) -> Reference:
    """Return a reference in which everything differs from standing."""
    rng = np.random.default_rng(34)
    return msgspec.structs.replace(
        standing_reference(model),
        com=[0.01, 0.02, 0.6],
        com_velocity=[0.1, 0.2, 0.3],
        com_acceleration=[1.0, 2.0, 3.0],
        base_quat_xyzw=random_quaternion(rng).coeffs().tolist(),
        posture=(model.robot.nominal + 0.1 * rng.normal(size=model.n_a)).tolist(),
        feet=[yawed([0.05, 0.12, 0.0], 0.2), yawed([-0.05, -0.13, 0.0], -0.3)],
    )


def test_reference_is_taken_over_whole(
    model: RobotModel, stance: Stance, reference: Reference
) -> None:
    stance.follow(reference, model)
    np.testing.assert_array_equal(stance.com, reference.com)
    np.testing.assert_array_equal(stance.com_velocity, reference.com_velocity)
    np.testing.assert_array_equal(stance.com_acceleration, reference.com_acceleration)
    rotation = pin.Quaternion(np.array(reference.base_quat_xyzw)).toRotationMatrix()
    np.testing.assert_allclose(stance.R_base, rotation, atol=TOLERANCE)
    np.testing.assert_array_equal(stance.posture[model.to_bus], reference.posture)
    for side, yaw in enumerate((0.2, -0.3)):
        np.testing.assert_array_equal(
            stance.p_sole[side], reference.feet[side].position
        )
        assert stance.yaw_sole[side] == pytest.approx(yaw)


def test_reference_without_feet_leaves_them_where_they_stand(
    model: RobotModel, stance: Stance, reference: Reference
) -> None:
    before = standing(model)
    stance.follow(msgspec.structs.replace(reference, feet=[]), model)
    np.testing.assert_array_equal(stance.p_sole, before.p_sole)
    assert stance.yaw_sole == before.yaw_sole


def test_standing_reference_changes_nothing(model: RobotModel, stance: Stance) -> None:
    before = standing(model)
    stance.follow(standing_reference(model), model)
    for name in ("com", "com_velocity", "com_acceleration", "R_base", "posture"):
        np.testing.assert_array_equal(getattr(stance, name), getattr(before, name))


def test_length_of_the_quaternion_does_not_matter(
    model: RobotModel, stance: Stance, reference: Reference
) -> None:
    stance.follow(reference, model)
    once = stance.R_base.copy()
    longer = [3.0 * number for number in reference.base_quat_xyzw]
    stance.follow(msgspec.structs.replace(reference, base_quat_xyzw=longer), model)
    np.testing.assert_allclose(stance.R_base, once, atol=TOLERANCE)


def test_base_error_leads_from_the_base_to_its_reference(stance: Stance) -> None:
    """R_world_base exp(error) = R_base: the error is in base axes."""
    rng = np.random.default_rng(35)
    for _ in range(SAMPLES):
        R_world_base = random_quaternion(rng).toRotationMatrix()
        stance.R_base[:] = random_quaternion(rng).toRotationMatrix()
        stance.compare_base(R_world_base)
        np.testing.assert_allclose(
            R_world_base @ pin.exp3(stance.base_error), stance.R_base, atol=1e-9
        )


@pytest.mark.parametrize("ground", [-0.3, 0.0, 0.3])
def test_height_is_held_within_reach_of_the_feet(
    model: RobotModel, stance: Stance, ground: float
) -> None:
    lowest, highest = model.com_travel
    over_feet = stance.com_nominal + ground
    for asked in (0.0, stance.com_nominal, 2.0):
        stance.com_height = asked
        stance.limit_height(ground, travel=model.com_travel)
        assert over_feet + lowest <= stance.com[2] <= over_feet + highest
        if over_feet + lowest <= asked <= over_feet + highest:
            assert stance.com[2] == asked


def at(model: RobotModel, stance: Stance, *, leans: float) -> Dynamics:
    """Compare a turned, moving robot with the stance."""
    q, v = model.nominal_configuration().copy(), np.zeros(model.n_v)
    q[7:] += joint_offsets(model, hip_pitch=leans)
    q[3:7] = pin.Quaternion(pin.exp3(np.array([0.0, leans, 0.0]))).coeffs()
    v[1] = 0.2
    dynamics = Dynamics(model)
    dynamics.update(q, v)
    stance.compare_base(pin.Quaternion(q[3:7]).toRotationMatrix())
    return dynamics


def test_a_start_off_its_reference_is_led_there(
    model: RobotModel, stance: Stance
) -> None:
    """From where it is and as fast as it moves, without a step."""
    dynamics, goal = at(model, stance, leans=0.3), stance.com.copy()
    whole = float(np.linalg.norm(dynamics.p_com - goal))
    approach = Approach(period_s=1e-3)
    approach.begin(dynamics, stance)
    asked, velocities = [], []
    while not approach.is_over:
        approach.move(stance, 1.0)
        asked.append(stance.com.copy())
        velocities.append(stance.com_velocity.copy())
        approach.move(stance, -1.0)
        approach.step()
        assert len(asked) < 10_000
    assert whole > 0.03
    assert np.linalg.norm(asked[0] - dynamics.p_com) < 0.021
    assert np.linalg.norm(asked[-1] - goal) < 1e-3
    assert np.linalg.norm(np.diff(asked, axis=0) / 1e-3 - velocities[:-1]) < 1e-6
    assert np.linalg.norm(np.diff(velocities, axis=0), axis=1).max() < 2e-3
    np.testing.assert_allclose(stance.com, goal, atol=1e-9)


def test_a_start_near_its_reference_is_asked_for_just_that(
    model: RobotModel, stance: Stance
) -> None:
    approach = Approach(period_s=1e-3)
    approach.begin(at(model, stance, leans=0.01), stance)
    assert approach.is_over


def test_references_that_can_be_followed_are_not_refused(
    model: RobotModel, reference: Reference
) -> None:
    limits = ReferenceLimits(model)
    assert limits.why_not(standing_reference(model)) == ""
    nominal = model.robot.nominal.tolist()
    assert limits.why_not(msgspec.structs.replace(reference, posture=nominal)) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"com": [5.0, 0.0, 600.0]}, "com x at 5 m, expected"),
        ({"com": [0.0, 1e300, 0.6]}, "com y at 1e\\+300 m, expected"),
        ({"com_velocity": [0.0, -100.0, 0.0]}, "com_velocity: 100 m/s, at most 3"),
        ({"com_acceleration": [1e9, 0.0, 0.0]}, "com_acceleration: 1e\\+09 m/s"),
        ({"base_quat_xyzw": [0.0, 0.0, 0.0, 0.0]}, "a quaternion of norm 0"),
        ({"posture": [50.0] * 28}, " at 50 rad, expected"),
        ({"feet": [yawed([50.0, 120.0, 0.0], 0.0)] * 2}, "foot position: 120 m"),
    ],
)
def test_what_would_throw_the_robot_over_is_refused(
    model: RobotModel, change: dict[str, object], words: str
) -> None:
    changed = msgspec.structs.replace(standing_reference(model), **change)
    assert re.search(words, ReferenceLimits(model).why_not(changed))
