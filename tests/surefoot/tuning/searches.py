"""Searches that take little time, since the robot only holds its posture."""

from __future__ import annotations

from pathlib import Path

from surefoot.tuning.ask import Spec, make_spec
from tests.surefoot import own_controllers

STILL = 'name = "still"\nduration_s = 0.02\n'
HOLDS = f"{Path(own_controllers.__file__).resolve()}:StayWithSettings"
"""Accepts settings, so that any may be searched, and holds its posture."""
PARAMS = {"tsid.com_kp": (10, 80), "dik.com_gain": (0.5, 8.0)}


def still(folder: Path) -> Path:
    """Return a short scenario in which nothing happens."""
    path = folder / "still.toml"
    path.write_text(STILL)
    return path


def spec_of(
    scenario: Path,
    *objectives: str,
    controller: str = HOLDS,
    sampler_seed: int = 0,
) -> Spec:
    """Return a search on a scenario."""
    return make_spec(
        [str(scenario)],
        PARAMS,
        objectives=list(objectives or ("com", "force")),
        seeds=[0],
        controller=controller,
        settings=None,
        overrides=(),
        robot="walker",
        servo_profile=None,
        sampler="tpe",
        sampler_seed=sampler_seed,
    )
