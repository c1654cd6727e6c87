from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.ground import PlatformPlan, plan_platforms
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.robot_spec import Stance
from tests.sim_robot.conftest import MakePlant, MakeScenario

PERIOD_S = 0.001
SOLE_LEFT = np.array([0.026, 0.11, 0.0])
SOLE_RIGHT = np.array([0.026, -0.11, 0.0])

WILD_MOTIONS: list[dict[str, Any]] = [
    {"axis": "x", "kind": "sine", "amplitude_m": 0.05, "frequency_hz": 0.8},
    {"axis": "y", "kind": "ramp", "amplitude_m": 0.05, "rate_m_s": 0.1},
    {"axis": "z", "kind": "drop", "amplitude_m": -0.02, "start_s": 0.05},
    {"axis": "z", "kind": "sine", "amplitude_m": 0.03, "frequency_hz": 1.1},
    {"axis": "yaw", "kind": "sine", "amplitude_deg": 20.0, "frequency_hz": 0.5},
    {"axis": "pitch", "kind": "sine", "amplitude_deg": 15.0, "frequency_hz": 0.7},
    {"axis": "roll", "kind": "ramp", "amplitude_deg": -12.0, "rate_deg_s": 30.0},
]


def rotation(axis: int, angle: float) -> Mat:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    return matrix


def pose(plant: Plant, name: str) -> tuple[Array, Mat]:
    body = plant.data.body(name)
    return body.xpos.copy(), body.xmat.reshape(3, 3).copy()


def twist_in_world(plant: Plant, name: str) -> tuple[Array, Array]:
    """Return the [linear; angular] velocity of a body's frame in world axes."""
    out = np.zeros(6)
    mujoco.mj_objectVelocity(
        plant.world.model,
        plant.data,
        mujoco.mjtObj.mjOBJ_XBODY,
        plant.data.body(name).id,
        out,
        0,
    )
    return out[3:], out[:3]


def vee(matrix: Mat) -> Array:
    return 0.5 * np.array(
        [
            matrix[2, 1] - matrix[1, 2],
            matrix[0, 2] - matrix[2, 0],
            matrix[1, 0] - matrix[0, 1],
        ]
    )


# The blends' accelerations change within a tick: a few mm/s of difference.
@pytest.mark.parametrize(
    ("foot", "kinds", "ticks", "tolerance"),
    [("both", {"sine", "ramp", "drop"}, 150, 4e-3), ("left", {"sine"}, 400, 1e-4)],
    ids=["wild", "smooth"],
)
def test_contacts_see_the_velocity_of_the_poses(
    make_plant: MakePlant,
    walker: Robot,
    foot: str,
    kinds: set[str],
    ticks: int,
    tolerance: float,
) -> None:
    """Central differences of the poses, one tick before and after."""
    motion = [one for one in WILD_MOTIONS if one["kind"] in kinds]
    plant = make_plant(platform=[{"foot": foot, "motion": motion}])
    poses, twists = [], []
    for _ in range(ticks):
        plant.step(walker.nominal)
        poses.append(pose(plant, f"ground_{foot}"))
        twists.append(twist_in_world(plant, f"ground_{foot}"))
    for before, here, after, (linear, angular) in zip(
        poses[:-2], poses[1:-1], poses[2:], twists[1:-1], strict=True
    ):
        moved = (after[0] - before[0]) / (2.0 * PERIOD_S)
        turned = vee((after[1] - before[1]) @ here[1].T) / (2.0 * PERIOD_S)
        np.testing.assert_allclose(linear, moved, atol=tolerance)
        np.testing.assert_allclose(angular, turned, atol=tolerance)


def test_rotations_compose_as_yaw_pitch_roll_after_translation(
    make_plant: MakePlant, walker: Robot
) -> None:
    ramps = [
        {"axis": axis, "kind": "ramp", "amplitude_deg": angle, "rate_deg_s": 400.0}
        for axis, angle in (("roll", 5.0), ("pitch", -7.0), ("yaw", 9.0))
    ]
    ramps.append({"axis": "x", "kind": "ramp", "amplitude_m": 0.01, "rate_m_s": 1.0})
    plant = make_plant(platform=[{"foot": "right", "motion": ramps}])
    start, _ = pose(plant, "ground_right")
    for _ in range(100):
        plant.step(walker.nominal)
    position, matrix = pose(plant, "ground_right")
    roll, pitch, yaw = np.radians([5.0, -7.0, 9.0])
    expected = rotation(2, yaw) @ rotation(1, pitch) @ rotation(0, roll)
    np.testing.assert_allclose(matrix, expected, atol=1e-12)
    np.testing.assert_allclose(position - start, [0.01, 0.0, 0.0], atol=1e-12)


def test_truth_tells_the_platform_poses_of_the_scenario(
    make_plant: MakePlant,
) -> None:
    plant = make_plant(platform=[{"foot": "right"}])
    (platform,) = plant.truth().platforms
    np.testing.assert_allclose(platform.quat_xyzw, [0.0, 0.0, 0.0, 1.0])
    assert platform.position[1] < 0.0
    assert plant.truth().platforms[0].position[2] == 0.0
    assert make_plant().truth().platforms == ()


def test_friction_carries_the_feet_along(make_plant: MakePlant, walker: Robot) -> None:
    speed = 0.05
    ramp = {"axis": "x", "kind": "ramp", "amplitude_m": 0.2, "rate_m_s": speed}
    plant = make_plant(platform=[{"foot": "both", "motion": [ramp]}])
    gap = plant.truth().sole_left - plant.truth().platforms[0].position
    for _ in range(3000):
        plant.step(walker.nominal)
    truth = plant.truth()
    platform_velocity, _ = twist_in_world(plant, "ground_both")
    sole_velocity, _ = twist_in_world(plant, walker.left.sole_frame)
    assert platform_velocity[0] == pytest.approx(speed)
    np.testing.assert_allclose(sole_velocity, platform_velocity, atol=1e-3)
    np.testing.assert_allclose(
        truth.sole_left - truth.platforms[0].position, gap, atol=1e-3
    )


def test_weight_does_not_hold_a_platform_back(
    make_plant: MakePlant, walker: Robot
) -> None:
    """The ground's motion is the scenario's, whatever stands on it."""
    lift = {"axis": "z", "kind": "ramp", "amplitude_m": 0.05, "rate_m_s": 0.2}
    plant = make_plant(platform=[{"foot": "both", "motion": [lift]}])
    for _ in range(200):
        plant.step(walker.nominal)
    height = plant.truth().platforms[0].position[2]
    assert height == pytest.approx(0.2 * (0.2 - 0.5 * 0.02), abs=1e-12)


STANCE = Stance(
    posture=np.zeros(1),
    base_quat_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
    soles=(SOLE_LEFT, SOLE_RIGHT),
    place=np.zeros(2),
    yaw=0.0,
)


def plans_by_name(scenario: Scenario) -> dict[str, PlatformPlan]:
    plans = plan_platforms(scenario, STANCE)
    return {plan.name: plan for plan in plans}


def test_feet_without_a_platform_stand_on_fixed_ground(
    make_scenario: MakeScenario,
) -> None:
    alone = plans_by_name(make_scenario())
    assert list(alone) == ["ground_both"]
    assert not alone["ground_both"].in_scenario
    assert alone["ground_both"].half_size[:2].min() > 10.0  # it may be made to walk
    one = plans_by_name(make_scenario(platform=[{"foot": "right"}]))
    assert list(one) == ["ground_right", "ground_left"]
    assert one["ground_right"].in_scenario
    assert not one["ground_left"].in_scenario


@pytest.mark.parametrize(
    "walk",
    [
        {"velocity_m_s": 0.25},
        {"velocity_m_s": -0.7},
        {"step": [{"side": "left", "position_m": [290.0, 0.1]}]},
    ],
)
@pytest.mark.parametrize("ground", [{}, {"platform": [{"foot": "both"}]}])
def test_ground_lasts_for_a_walk_of_five_minutes(
    make_scenario: MakeScenario, walk: dict[str, Any], ground: dict[str, Any]
) -> None:
    plans = plans_by_name(make_scenario(duration_s=300.0, walk=walk, **ground))
    farthest = 290.0 if "step" in walk else 300.0 * abs(walk["velocity_m_s"])
    assert plans["ground_both"].half_size[:2].min() > farthest


def test_platforms_of_two_feet_lie_under_them_without_overlap(
    make_scenario: MakeScenario,
) -> None:
    plans = plans_by_name(make_scenario(platform=[{"foot": "left"}, {"foot": "right"}]))
    for name, sole, outward in (
        ("ground_left", SOLE_LEFT, 1.0),
        ("ground_right", SOLE_RIGHT, -1.0),
    ):
        plan = plans[name]
        centre = plan.top_centre + plan.box_centre
        np.testing.assert_allclose(plan.top_centre, sole)
        assert (centre + plan.half_size)[2] == pytest.approx(0.0)
        inner = outward * centre[1] - plan.half_size[1]
        assert inner == pytest.approx(0.01)
