"""The baseline on the simulated robot stands and takes pushes."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.schemas.toml_file import read_toml
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.factory import PRESETS_DIR, find_settings, shipped_settings
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.zmp.controller import ZmpController
from tests.stabilizer.closed_loop import Run, run_closed_loop

IMPULSE_N_S, PUSH_S = 15.0, 0.1
PUSHED_AT_S, RUN_S = 0.8, 2.8
MOVED_M = 4e-3
"""Least motion of the robot that counts as a push [m]."""
BACK_M = 4e-3
STILL_M = 2e-3
AWAY_S = 1.0


def preset(name: str) -> ControllerSettings:
    return build_settings(read_toml(PRESETS_DIR / f"{name}.toml"), overrides=[])


def com_error(model: RobotModel, run: Run) -> Array:
    """Return (n, 2) horizontal CoM relative to the midpoint of the soles [m]."""
    over = run.com_true - run.soles_true.mean(axis=1)
    error: Array = (over - standing(model).com)[:, :2]
    return error


@pytest.mark.closed_loop
def test_it_stands_still(walker: Robot, model: RobotModel) -> None:
    controller = ZmpController(walker, preset("zmp-tuned"))
    run = run_closed_loop(walker, controller=controller, duration_s=2.0)
    assert run.statuses == {"ok"}
    assert np.abs(com_error(model, run)[run.time_s > AWAY_S]).max() < STILL_M


@pytest.mark.closed_loop
@pytest.mark.parametrize(
    ("name", "angle_deg"), [("zmp-stock", 0.0), ("zmp-tuned", 225.0)]
)
def test_it_recovers_from_a_push(
    walker: Robot, model: RobotModel, name: str, angle_deg: float
) -> None:
    angle = np.radians(angle_deg)
    force = IMPULSE_N_S / PUSH_S * np.array([np.cos(angle), np.sin(angle), 0.0])
    push = {
        "body": "torso",
        "force_n": force.tolist(),
        "start_s": PUSHED_AT_S,
        "duration_s": PUSH_S,
    }
    run = run_closed_loop(
        walker,
        controller=ZmpController(walker, preset(name)),
        duration_s=RUN_S,
        push=[push],
    )
    assert not run.fell
    assert run.statuses == {"ok"}
    error = com_error(model, run)
    along = error @ force[:2] / np.linalg.norm(force)
    assert along.max() > MOVED_M
    assert np.abs(error[-100:]).max() < BACK_M


def test_tuned_settings_are_the_defaults() -> None:
    assert preset("zmp-tuned") == ControllerSettings()


@pytest.mark.parametrize(
    "name", [name for name in shipped_settings() if name.startswith("zmp-")]
)
def test_shipped_settings_name_every_setting_of_the_baseline(name: str) -> None:
    table = read_toml(PRESETS_DIR / f"{name}.toml")
    fields = {field.name for field in msgspec.structs.fields(type(preset(name).zmp))}
    assert set(table) == {"zmp"}
    assert set(table["zmp"]) == fields


def test_published_gains_and_clamps_are_as_published() -> None:
    zmp = preset("zmp-stock").zmp
    assert (zmp.dcm_prop_gain, zmp.dcm_integral_gain, zmp.dcm_deriv_gain) == (
        5.0,
        10.0,
        0.0,
    )
    assert (zmp.dcm_integrator_time_constant_s, zmp.max_average_dcm_error_m) == (
        10.0,
        0.05,
    )
    assert zmp.cop_admittance == (0.01, 0.01)
    assert (zmp.dfz_admittance, zmp.vdc_frequency) == (1e-4, 1.0)
    assert (zmp.max_fdc_velocity_rad_s, zmp.contact_damping) == (0.2, 300.0)
    assert (zmp.friction, zmp.min_ds_pressure_n) == (0.7, 15.0)
    assert (zmp.level_base, zmp.level_height) == (0.0, 0.0)


def test_settings_are_found_by_name() -> None:
    assert find_settings(Path("zmp-stock")) == PRESETS_DIR / "zmp-stock.toml"
    own = Path("somewhere/zmp-stock")
    assert find_settings(own) == own
