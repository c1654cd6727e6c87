from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.ticks.table import MemoryTicks
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.errors import RenderError
from surefoot.sim_robot.plant import Plant
from surefoot.sim_robot.png import write_png
from surefoot.sim_robot.render import Camera, Renderer
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.sim_robot.world import build_world

WIDTH, HEIGHT = 160, 120
TILT = {"axis": "roll", "kind": "ramp", "amplitude_deg": 10.0, "rate_deg_s": 100.0}


def read_png(path: Path) -> np.ndarray:
    """Read back what write_png writes: one IDAT, no filters."""
    data = path.read_bytes()
    width, height = struct.unpack(">II", data[16:24])
    start = data.index(b"IDAT")
    (length,) = struct.unpack(">I", data[start - 4 : start])
    rows = np.frombuffer(
        zlib.decompress(data[start + 4 : start + 4 + length]), dtype=np.uint8
    )
    return rows.reshape(height, 1 + 3 * width)[:, 1:].reshape(height, width, 3)


def test_png_holds_the_picture(tmp_path: Path) -> None:
    image = np.random.default_rng(1).integers(0, 256, size=(7, 5, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", image)
    np.testing.assert_array_equal(read_png(tmp_path / "a.png"), image)


def test_png_refuses_what_is_no_picture(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"got float64 of shape \(4, 4\)"):
        write_png(tmp_path / "a.png", np.zeros((4, 4)))  # type: ignore[arg-type]
    assert not (tmp_path / "a.png").exists()


def test_scenery_does_not_change_the_plant(
    walker: Robot, make_scenario: Callable[..., Scenario]
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
        "from robot_io.robot import load_robot\n"
        "from sim_robot.catalogue import load_scenario\n"
        "from sim_robot.render import Renderer\n"
        "Renderer(load_robot('walker'), load_scenario('standing'),"
        " width=32, height=24)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", script],
        env={
            **os.environ,
            "MUJOCO_GL": "disabled",
            "PYTHONPATH": os.pathsep.join(sys.path),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 1
    assert "RenderError: no picture can be drawn" in ran.stderr
    assert "apt-get install libegl1" in ran.stderr


def open_renderer(walker: Robot, scenario: Scenario) -> Renderer:
    try:
        return Renderer(walker, scenario, width=WIDTH, height=HEIGHT)
    except RenderError as error:
        pytest.skip(str(error))


def test_moving_the_ground_changes_the_picture(
    walker: Robot, make_scenario: Callable[..., Scenario], standing_plant: Plant
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
    walker: Robot, make_scenario: Callable[..., Scenario]
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
