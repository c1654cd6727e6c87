"""Humanoids of other makers: from URDF to a standing robot by new-robot alone."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import surefoot as sf
from benchmarks.humanoids import HUMANOIDS
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.scenario import Scenario
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.legs import ONE_FOOT_SHARE, one_foot_share
from tests.humanoids import make_humanoid

LEVEL_M, LEVEL_RAD = 1e-4, 1e-3
"""Tolerances, since nominal angles are written with four digits."""
SHORT = Scenario(name="short", duration_s=0.8)


def check_posture(model: RobotModel) -> None:
    """Check level soles side by side, the CoM over their middle, sensors with mass."""
    dynamics = Dynamics(model)
    dynamics.update(model.nominal_configuration(), np.zeros(model.n_v))
    for sole_id in model.sole_ids:
        turned, place = dynamics.frame_placement(sole_id)
        assert abs(place[2]) < LEVEL_M
        np.testing.assert_allclose(turned, np.eye(3), atol=LEVEL_RAD)
    np.testing.assert_allclose(dynamics.p_com[:2], 0.0, atol=5 * LEVEL_M)
    assert all(plate.mass > 0.0 for plate in model.plates)
    assert np.all(model.nominal >= model.lower)
    assert np.all(model.nominal <= model.upper)


@pytest.mark.parametrize("name", ["jvrc", "talos"])
def test_its_posture_is_one_to_stand_in(name: str, tmp_path: Path) -> None:
    check_posture(RobotModel(make_humanoid(name, tmp_path).robot))


@pytest.mark.closed_loop
@pytest.mark.process
@pytest.mark.usual("icub")  # the most awkward frames
@pytest.mark.parametrize("name", HUMANOIDS)
def test_it_stands_and_its_run_is_the_same_over_the_bus(
    name: str, tmp_path: Path
) -> None:
    robot = make_humanoid(name, tmp_path).robot
    check_posture(RobotModel(robot))
    alone = sf.simulate(robot, SHORT)
    assert alone.outcome is Outcome.STOOD
    assert alone.result.base_tilt_max_deg < 1.0
    assert max(alone.result.force_peak_n) < 0.7 * 9.81 * RobotModel(robot).mass
    over_bus = sf.run(robot, SHORT)
    assert over_bus.outcome is Outcome.STOOD
    assert over_bus.result.log_sha256 == alone.result.log_sha256


def test_its_knees_carry_it_on_one_foot(tmp_path: Path) -> None:
    """JVRC-1's have 100 N m, and would need 114 where they were bent for the reach."""
    robot = make_humanoid("jvrc", tmp_path).robot
    assert 0.5 < one_foot_share(RobotModel(robot)) <= ONE_FOOT_SHARE + 0.01


@pytest.mark.closed_loop
@pytest.mark.usual("jvrc")
@pytest.mark.parametrize("name", ["jvrc", "g1", "icub"])
def test_it_walks_untuned(name: str, tmp_path: Path) -> None:
    robot = make_humanoid(name, tmp_path).robot
    walk = msgspec.structs.replace(sf.load_scenario("walk-flat-slow"), duration_s=8.0)
    assert walk.walk is not None
    speed = msgspec.structs.replace(walk.walk, velocity_m_s=0.15)
    run = sf.simulate(robot, msgspec.structs.replace(walk, walk=speed))
    assert run.outcome is Outcome.WALKED
    assert run.result.steps_done is not None
    assert run.result.steps_done >= 4
