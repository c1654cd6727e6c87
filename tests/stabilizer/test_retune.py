from __future__ import annotations

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.reasons import EndReason
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.stabilizer.controller import HoldController, Tunable
from surefoot.stabilizer.requests import LIVE_SETTINGS, live_values, with_values
from surefoot.stabilizer.safety.health import FRESH
from surefoot.stabilizer.safety.safety import Safety
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import ROLLING, Run, run_closed_loop

DEFAULTS = build_settings(
    {}, overrides=["estimator.calibration_s=0.02", "dik.ramp_in_s=0.02"]
)
"""They balance soon."""
CHANGED = with_values(
    DEFAULTS,
    {
        name: [1.5 * number if number else 0.25 for number in numbers]
        if name != "ground.gain"
        else [0.5 * number for number in numbers]
        for name, numbers in live_values(DEFAULTS).items()
    },
)
TICKS = 150
"""Longer than calibration and fade-in, on moving ground."""


@pytest.fixture(scope="module")
def run(walker: Robot) -> Run:
    """Run with the default gains."""
    controller = WholeBodyController(walker, DEFAULTS)
    return run_closed_loop(
        walker, controller=controller, duration_s=TICKS * 1e-3, platform=ROLLING
    )


@pytest.mark.closed_loop
@pytest.mark.parametrize("name", LIVE_SETTINGS)
def test_gains_changed_later_act_like_gains_from_the_start(
    walker: Robot, run: Run, name: str
) -> None:
    wanted = with_values(DEFAULTS, {name: live_values(CHANGED)[name]})
    built, retuned = (
        WholeBodyController(walker, settings) for settings in (wanted, DEFAULTS)
    )
    retuned.retune(wanted)
    for controller in (built, retuned):
        controller.start(run.snapshots[0], walker.nominal)
    differs = False
    for snapshot, unchanged in zip(run.snapshots, run.commands, strict=True):
        expected = built.step(snapshot).q_command.copy()
        np.testing.assert_array_equal(retuned.step(snapshot).q_command, expected)
        differs |= bool((unchanged != expected).any())
    assert differs, f"{name} changes nothing: a test of nothing"


def test_a_controller_without_gains_is_not_tunable(walker: Robot) -> None:
    assert isinstance(WholeBodyController(walker, DEFAULTS), Tunable)
    assert not isinstance(HoldController(walker.n_a), Tunable)


class _RefusesGains(HoldController):
    def retune(self, settings: ControllerSettings) -> None:
        raise ValueError(f"no gains of {settings.dik.k_force}")


def test_one_that_raises_at_new_gains_is_given_up_in_order(
    walker: Robot, run: Run
) -> None:
    safety = Safety(_RefusesGains(walker.n_a), walker, DEFAULTS.safety)
    safety.start(run.snapshots[0], walker.nominal)
    safety.retune(CHANGED)
    assert safety.end is EndReason.CONTROLLER_FAILED
    assert "ValueError: no gains of" in safety.detail
    output = safety.step(run.snapshots[1], FRESH)
    np.testing.assert_array_equal(output.q_command, walker.nominal)
