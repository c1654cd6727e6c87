from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.ticks.recorder import MemoryTicks
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.render import Camera, Renderer, RenderError
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.sim_robot.world import build_world
from tests.command import run_python
from tests.sim_robot.conftest import MakeScenario

WIDTH, HEIGHT = 160, 120
PLAIN = 20
"""A pixel that differs by more, of 255, differs in more than a shadow's grain."""
TILT = {"axis": "roll", "kind": "ramp", "amplitude_deg": 10.0, "rate_deg_s": 100.0}


def test_scenery_does_not_change_the_plant(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    scenario = make_scenario(platform=[{"foot": "both", "motion": [TILT]}])
    plain = build_world(walker, scenario)
    dressed = build_world(walker, scenario, scenery=True)
    assert dressed.model.nq == plain.model.nq
    assert dressed.model.npair == plain.model.npair
    assert not dressed.model.geom_contype.any()
    assert dressed.weight == pytest.approx(plain.weight)
    np.testing.assert_array_equal(dressed.joint_qpos, plain.joint_qpos)


def test_missing_graphics_say_what_to_install() -> None:
    """In a process of its own: MuJoCo chooses its back end when it is imported."""
    script = (
        "from surefoot.robot_io.robot import load_robot\n"
        "from surefoot.sim_robot.catalogue import load_scenario\n"
        "from surefoot.sim_robot.render import Renderer\n"
        "Renderer(load_robot('walker'), load_scenario('standing'),"
        " width=32, height=24)\n"
    )
    ran = run_python("-c", script, MUJOCO_GL="disabled")
    assert ran.returncode == 1
    assert "RenderError: no picture can be drawn" in ran.stderr
    assert "apt-get install libegl1" in ran.stderr


def open_renderer(walker: Robot, scenario: Scenario) -> Renderer:
    try:
        return Renderer(walker, scenario, width=WIDTH, height=HEIGHT)
    except RenderError as error:
        pytest.skip(str(error))


def test_a_seesaw_is_drawn_as_it_was_recorded(
    walker: Robot, make_scenario: MakeScenario, standing_plant: Plant
) -> None:
    plank = {"center_m": [0.6, 0.0], "size_m": [0.5, 0.5], "tip_deg": 10.0}
    truth = standing_plant.truth()
    quats = Rotation.from_euler("y", [[0.0], [10.0]], degrees=True).as_quat()
    arrays = {
        "time_s": np.zeros(2),
        "true_base_pose": np.tile(
            np.concatenate([truth.base_position, truth.base_quat_xyzw]), (2, 1)
        ),
        "q": np.tile(walker.nominal, (2, 1)),
        "true_platform_pose": np.array([[[0.6, 0.0, 0.0, *quat]] for quat in quats]),
    }
    with open_renderer(walker, make_scenario(tile=[plank])) as renderer:
        level, again, tipped = (
            renderer.draw_recorded(arrays, row=row).astype(int) for row in (0, 0, 1)
        )
    assert np.abs(level - again).max() < PLAIN
    assert np.abs(level - tipped).max() > PLAIN


def test_moving_the_ground_changes_the_picture(
    walker: Robot, make_scenario: MakeScenario, standing_plant: Plant
) -> None:
    scenario = make_scenario(platform=[{"foot": "both", "motion": [TILT]}])
    truth = standing_plant.truth()
    with open_renderer(walker, scenario) as renderer:
        level, again, tilted = (
            renderer.draw(
                time_s=time_s,
                base_position=truth.base_position,
                base_quat_xyzw=truth.base_quat_xyzw,
                q=walker.nominal,
                camera=Camera(distance=2.5),
            )
            for time_s in (0.0, 0.0, 2.0)
        )
    assert level.shape == (HEIGHT, WIDTH, 3)
    assert level.std() > 10.0
    np.testing.assert_array_equal(level, again)
    assert not np.array_equal(level, tilted)


def test_recorded_run_can_be_drawn_from_its_signals(
    walker: Robot, make_scenario: MakeScenario
) -> None:
    scenario = make_scenario(
        duration_s=0.2, platform=[{"foot": "both", "motion": [TILT]}]
    )
    ticks = MemoryTicks()
    simulated = SimulatedRobot(walker, scenario, seed=0, ticks=ticks)
    while not simulated.finished:
        simulated.step()
    arrays = {name: ticks.read(name) for name in ticks.layouts}
    with open_renderer(walker, scenario) as renderer:
        first = renderer.draw_recorded(arrays, row=0)
        last = renderer.draw_recorded(arrays, row=-1)
    assert not np.array_equal(first, last)
