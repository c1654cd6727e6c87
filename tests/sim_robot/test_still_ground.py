from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.robot_io.robot import Robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.sim_robot.catalogue import load_scenario
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.state_view import ground_blocks
from surefoot.sim_robot.still_ground import FLOOR_M, plan_still_ground

WEIGHT_TOLERANCE_N = 2.0
TIP_DEG = 2.0


def _scenario(*tiles: dict[str, Any], **more: Any) -> Scenario:
    raw = {"name": "tiles", "duration_s": 1.0, "tile": list(tiles), **more}
    return scenario_from_table(raw, source="here")


def _stands(robot: Robot, *tiles: dict[str, Any], **more: Any) -> Plant:
    plant = Plant(robot, _scenario(*tiles, **more), seed=0)
    weight = sum(plant.view.vertical_forces)
    assert weight == pytest.approx(plant.world.weight, abs=WEIGHT_TOLERANCE_N)
    return plant


def _area_without(tiles: list[dict[str, Any]], *, samples: int = 4000) -> float:
    """Return the share of random places on the floor without a tile."""
    random = np.random.default_rng(5)
    places = random.uniform([-0.5, -1.0], [2.0, 1.0], (samples, 2))
    free = 0
    grounds = plan_still_ground(_scenario(*tiles))
    floor = [g for g in grounds if g.name.startswith("floor")]
    for x, y in places:
        on_floor = sum(g.height_at(x, y) is not None for g in floor)
        on_tile = any(
            abs(x - t["center_m"][0]) < 0.5 * t["size_m"][0]
            and abs(y - t["center_m"][1]) < 0.5 * t["size_m"][1]
            for t in tiles
        )
        assert on_floor == (0 if on_tile else 1)
        free += not on_tile
    return free / samples


def test_floor_goes_on_around_tiles_and_never_under_them() -> None:
    tiles = [
        {"center_m": [0.4, 0.1], "size_m": [0.3, 0.3], "height_m": 0.02},
        {"center_m": [0.5, 0.2], "size_m": [0.3, 0.3], "height_m": -0.02},
        {"center_m": [1.2, -0.4], "size_m": [0.5, 0.2], "roll_deg": 3.0},
    ]
    assert 0.8 < _area_without(tiles) < 1.0


@pytest.mark.parametrize("gap_m", [0.0, 1e-7])
@pytest.mark.parametrize("axis", [0, 1])
def test_no_floor_stands_between_tiles_that_touch(axis: int, gap_m: float) -> None:
    # 0.387 + 0.16 and 0.707 - 0.16 differ by the last bit.
    tiles = [
        {"center_m": [at, 0.0][:: 1 - 2 * axis], "size_m": size, "height_m": -0.1}
        for at, size in ((0.387, [0.32, 0.32]), (0.707 + gap_m, [0.32, 0.32]))
    ]
    floor = [
        ground
        for ground in plan_still_ground(_scenario(*tiles))
        if ground.name.startswith("floor")
    ]
    assert len(floor) == 4
    assert min(size for ground in floor for size in ground.size[:2]) > 0.3


@pytest.mark.parametrize("name", ["walk-stairs", "walk-tiles", "walk-soft"])
def test_shipped_floors_have_no_slivers(name: str) -> None:
    for ground in plan_still_ground(load_scenario(name)):
        assert min(ground.size[:2]) > 1e-3


def test_floor_is_as_large_as_a_walk_needs() -> None:
    ground = plan_still_ground(
        _scenario({"center_m": [1.0, 0.0], "size_m": [0.3, 0.3], "height_m": 0.02})
    )
    for x, y in ((FLOOR_M[0][1] - 0.1, 0.0), (0.0, 5.0), (-2.5, -5.0), (1.0, 0.5)):
        assert any(g.height_at(x, y) == 0.0 for g in ground)


@pytest.mark.parametrize(
    ("walk", "x", "y"),
    [
        ({"velocity_m_s": 0.25}, 75.0, 0.0),
        ({"velocity_m_s": -0.25}, -75.0, 0.0),
        ({"velocity_m_s": 0.25, "yaw_rate_deg_s": 3.0}, 0.0, -75.0),
    ],
)
def test_ground_lasts_for_a_walk_of_five_minutes(
    walk: dict[str, float], x: float, y: float
) -> None:
    tile = {"center_m": [1.0, 0.0], "size_m": [0.3, 0.3], "height_m": 0.02}
    ground = plan_still_ground(_scenario(tile, duration_s=300.0, walk=walk))
    assert any(g.height_at(x, y) == 0.0 for g in ground)


def test_no_tiles_no_such_ground() -> None:
    assert plan_still_ground(_scenario()) == ()


def test_stands_on_a_tile_at_its_height(walker: Robot) -> None:
    tile = {"center_m": [0.0, 0.0], "size_m": [1.0, 1.0], "height_m": 0.12}
    plant = _stands(walker, tile)
    assert plant.view.sole_left[2] == pytest.approx(0.12, abs=1e-4)


def test_each_foot_stands_on_a_tile_of_its_own(walker: Robot) -> None:
    sizes = {"size_m": [0.6, 0.4], "height_m": 0.05}
    left = {"center_m": [0.0, 0.25], **sizes}
    right = {"center_m": [0.0, -0.25], **sizes}
    plant = _stands(walker, left, right)
    for sole in (plant.view.sole_left, plant.view.sole_right):
        assert sole[2] == pytest.approx(0.05, abs=1e-4)


def test_tilted_ground_tilts_the_sole_as_written(walker: Robot) -> None:
    tilt = {"center_m": [0.0, 0.0], "size_m": [1.0, 1.0], "pitch_deg": 1.5}
    plant = _stands(walker, tilt)
    tile = plant.world.still[0]
    assert tile.height_at(0.2, 0.0) == pytest.approx(-0.2 * math.tan(math.radians(1.5)))
    ahead = {"center_m": [0.0, 0.0], "size_m": [1.0, 1.0], "roll_deg": 4.0}
    rolled = plan_still_ground(_scenario(ahead))[0]
    assert rolled.height_at(0.0, 0.2) == pytest.approx(
        0.2 * math.tan(math.radians(4.0))
    )
    assert plant.view.sole_tilts[0] > math.radians(1.2)


@pytest.mark.parametrize("stiffness", [2e4, 1e5, 1e6])
@pytest.mark.parametrize("damping", [None, 500.0])
def test_soft_ground_gives_way_by_force_over_stiffness(
    walker: Robot, stiffness: float, damping: float | None
) -> None:
    tile: dict[str, Any] = {
        "center_m": [0.0, 0.0],
        "size_m": [1.0, 1.0],
        "stiffness_n_m": stiffness,
    }
    if damping is not None:
        tile["damping_n_s_m"] = damping
    plant = _stands(walker, tile)
    depth = -float(plant.view.sole_left[2])
    assert depth == pytest.approx(plant.view.normal_forces[0] / stiffness, rel=0.02)


def test_a_slippery_tile_lets_the_sole_slide(walker: Robot) -> None:
    def slid(friction: float) -> float:
        tile = {
            "center_m": [0.0, 0.0],
            "size_m": [2.0, 2.0],
            "pitch_deg": 1.0,
            "friction": friction,
        }
        plant = Plant(walker, _scenario(tile), seed=0)
        begin = float(plant.view.sole_left[0])
        for _ in range(200):
            plant.step(walker.nominal)
        return float(plant.view.sole_left[0]) - begin

    assert slid(0.005) > 0.01
    assert abs(slid(0.7)) < 1e-3


@pytest.mark.parametrize(
    ("center", "axis", "sole_up"),
    [
        ([0.25, 0.0], "pitch", [-1.0, 0.0]),  # the feet are behind its middle
        ([-0.25, 0.0], "pitch", [1.0, 0.0]),
        ([0.0, 0.35], "roll", [0.0, -1.0]),
        ([0.0, -0.35], "roll", [0.0, 1.0]),
    ],
)
def test_a_seesaw_tips_to_its_stop_under_who_stands_off_its_middle(
    walker: Robot, center: list[float], axis: str, sole_up: list[float]
) -> None:
    plank = {"center_m": center, "size_m": [1.5, 1.5], "tip_axis": axis}
    plant = Plant(walker, _scenario({**plank, "tip_deg": TIP_DEG}), seed=0)
    for _ in range(250):
        plant.step(walker.nominal)
    (pose,) = plant.truth().platforms
    normal = Rotation.from_quat(pose.quat_xyzw).as_matrix()[:, 2]
    wanted = math.sin(math.radians(TIP_DEG)) * np.array(sole_up)
    np.testing.assert_allclose(normal[:2], wanted, atol=2e-3)
    assert pose.position == pytest.approx([*center, 0.0])
    assert math.degrees(plant.view.sole_tilts[0]) == pytest.approx(TIP_DEG, abs=0.5)


def test_a_seesaw_that_nobody_stands_on_keeps_still_beside_a_platform(
    walker: Robot,
) -> None:
    wave = {"axis": "z", "kind": "sine", "amplitude_m": 0.02, "frequency_hz": 1.0}
    platform = {"foot": "both", "motion": [wave]}
    plank = {"center_m": [1.0, 0.0], "size_m": [0.4, 0.4], "tip_deg": 5.0}

    def moved(*tiles: dict[str, Any]) -> Plant:
        plant = Plant(walker, _scenario(*tiles, platform=[platform]), seed=0)
        for _ in range(200):
            plant.step(walker.nominal)
        return plant

    alone, beside = moved(), moved(plank)
    ground, seesaw = beside.truth().platforms
    assert ground.position == pytest.approx(alone.truth().platforms[0].position)
    assert seesaw.position == pytest.approx([1.0, 0.0, 0.0])
    assert seesaw.quat_xyzw == pytest.approx([0.0, 0.0, 0.0, 1.0])
    blocks = ground_blocks(beside.world)
    assert [block.platform for block in blocks] == [0, 1]
    np.testing.assert_allclose(beside.view.com, alone.view.com, atol=1e-9)


def test_tiles_beside_a_platform_have_no_floor() -> None:
    scenario = _scenario(
        {"center_m": [1.0, 0.0], "size_m": [0.5, 0.5]},
        platform=[{"foot": "both", "size_m": [1.5, 1.2]}],
    )
    assert [ground.name for ground in plan_still_ground(scenario)] == ["tile_0"]


def test_a_platform_has_the_size_that_was_asked_for(walker: Robot) -> None:
    platform = {"foot": "both", "size_m": [3.0, 2.0]}
    plant = Plant(walker, _scenario(platform=[platform]), seed=0)
    assert plant.world.platforms[0].half_size[:2] == pytest.approx([1.5, 1.0])
    left = {"foot": "left", "size_m": [0.5, 0.8]}
    single = Plant(walker, _scenario(platform=[left]), seed=0).world.platforms[0]
    inner_edge = single.top_centre[1] + single.box_centre[1] - single.half_size[1]
    assert inner_edge == pytest.approx(0.01)


def test_firm_ground_has_no_damping_of_its_own() -> None:
    with pytest.raises(FileFormatError, match="needs `stiffness_n_m`"):
        _scenario({"center_m": [0, 0], "size_m": [1, 1], "damping_n_s_m": 10.0})
