"""A foot whose pressure is wanted at its edge does not tip over that edge."""

from __future__ import annotations

import numpy as np
import pytest

import surefoot as sf
from surefoot.schemas.arrays import Array
from surefoot.stabilizer.model import RobotModel
from tests.stabilizer.laws import HALF_SIZES, NO_GAIN, PAPER, make_law, settings_with
from tests.stabilizer.rig import BOTH, Rig
from tests.stabilizer.states import states_near_stance

FLAT = settings_with(ground={"gain": NO_GAIN}, dik={"stance_leak": 0.0})
LOAD_N = 300.0
EDGE = 0.9
"""Part of the sole that the first QP may use."""
EXACT = 1e-9
EDGES = pytest.mark.parametrize(
    ("axis", "end"), [(3, 1.0), (3, -1.0), (4, 1.0), (4, -1.0)]
)
"""The four edges of a sole: moment about x (3) or y (4), and its sign."""
MOST_SHAKEN_N = 700.0
"""Without this law, tipping feet came down with 980 N."""


def pressed(axis: int, share: float) -> Array:
    """Return wrenches with the pressure at a share of the way to the edge."""
    half = HALF_SIZES[0][0 if axis == 4 else 1]
    F = np.zeros(12)
    for start in (0, 6):
        F[start + 2] = LOAD_N
        F[start + axis] = share * half * LOAD_N
    return F


def twists(model: RobotModel, axis: int, *, measured: float, wanted: float) -> Array:
    """Return (n, 2, 12) twists for random states and errors: the paper's, ours."""
    rig = Rig(model, FLAT)
    rng = np.random.default_rng(3)
    found = []
    for state in states_near_stance(model, count=20, seed=4, spread=0.05, speed=0.0):
        rig.go(state)
        error = np.zeros(12)
        error[[0, 1, 2, 6, 7, 8]] = 15.0 * rng.normal(size=6)
        F_id, F_meas = pressed(axis, wanted), pressed(axis, measured) + error
        # The load's error must not move the centre of pressure.
        for start in (0, 6):
            F_meas[start + axis] *= F_meas[start + 2] / LOAD_N
        found.append(
            [
                make_law(settings)
                .update(
                    rig.dynamics,
                    rig.stance,
                    F_meas=F_meas,
                    F_id=F_id,
                    in_contact=BOTH,
                )
                .copy()
                for settings in (PAPER, FLAT)
            ]
        )
    return np.array(found)


@EDGES
def test_a_foot_at_its_edge_never_turns_further_over_it(
    model: RobotModel, axis: int, end: float
) -> None:
    paper, flat = np.moveaxis(
        twists(model, axis, measured=end, wanted=EDGE * end), 1, 0
    )
    for start in (0, 6):
        assert (end * paper[:, start + axis] < -EXACT).any()  # the test can fail
        assert (end * flat[:, start + axis] >= -EXACT).all()


@EDGES
def test_the_pressed_point_moves_as_the_forces_ask(
    model: RobotModel, axis: int, end: float
) -> None:
    half = HALF_SIZES[0][0 if axis == 4 else 1]
    found = twists(model, axis, measured=end, wanted=EDGE * end)
    for start in (0, 6):
        rate = found[..., start + 2] + found[..., start + axis] * end * half
        np.testing.assert_allclose(rate[:, 1], rate[:, 0], atol=EXACT)


@EDGES
@pytest.mark.parametrize(
    ("measured", "wanted"), [(0.5, 0.9), (0.85, 0.9), (1.0, 0.5), (1.0, -0.9)]
)
def test_elsewhere_the_law_is_the_papers(
    model: RobotModel, axis: int, end: float, measured: float, wanted: float
) -> None:
    """Inside the sole moments show a rotation; wanted inside, they bring it back."""
    found = twists(model, axis, measured=measured * end, wanted=wanted * end)
    np.testing.assert_array_equal(found[:, 1], found[:, 0])


@pytest.mark.closed_loop
def test_feet_do_not_slap_the_ground_that_shakes_sideways() -> None:
    motion = sf.SineMotion(axis="y", amplitude_m=0.012, frequency_hz=2.5, start_s=0.5)
    scenario = sf.Scenario(
        name="shaken",
        duration_s=2.5,
        platform=[sf.Platform(foot="both", motion=[motion])],
    )
    result = sf.simulate("walker", scenario, record=False).result
    assert result.outcome == "stood"
    assert result.force_peak_n is not None
    assert max(result.force_peak_n) < MOST_SHAKEN_N
