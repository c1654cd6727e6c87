"""Foot admittance: every foot yields; signs, numbers and clamps."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from surefoot.schemas.arrays import Array, Mat
from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.zmp.foot_admittance import FootAdmittance

SETTINGS = ZmpSettings(
    cop_admittance=(0.01, 0.02),
    dfz_admittance=1e-4,
    vdc_frequency=1.0,
    dfz_damping=0.0,
    max_fdc_velocity_rad_s=0.2,
    max_vertical_velocity_m_s=0.1,
    touchdown_admittance=2e-4,
)
HALF_WEIGHT = 343.0
BOTH, RIGHT = [True, True], [False, True]
LEVEL = [np.eye(3), np.eye(3)]
GROUND = [np.array([0.0, 0.1, 0.0]), np.array([0.0, -0.1, 0.0])]
EXACT = 1e-12


def foot(force: float = HALF_WEIGHT, x: float = 0.0, y: float = 0.0) -> Array:
    """Return (6,) a normal force with its centre of pressure at x, y."""
    return np.array([0.0, 0.0, force, y * force, -x * force, 0.0])


def feet(left: Array, right: Array) -> Array:
    return np.concatenate((left, right))


EVEN = feet(foot(), foot())


def twist(
    F_meas: Array,
    F_desired: Array = EVEN,
    *,
    settings: ZmpSettings = SETTINGS,
    in_contact: list[bool] = BOTH,
    R_measured: list[Mat] = LEVEL,
    R_commanded: list[Mat] = LEVEL,
    lifted: tuple[float, float] = (0.0, 0.0),
) -> Array:
    return FootAdmittance(settings).update(
        F_meas=F_meas,
        F_desired=F_desired,
        in_contact=in_contact,
        R_measured=R_measured,
        R_commanded=R_commanded,
        p_commanded=[
            p + np.array([0.0, 0.0, z]) for p, z in zip(GROUND, lifted, strict=True)
        ],
        p_stance=GROUND,
    )


def test_as_wanted_no_foot_moves() -> None:
    np.testing.assert_allclose(twist(EVEN), 0.0, atol=EXACT)


def test_pressure_too_far_forward_lifts_the_toe() -> None:
    """10 mm too far forward: -0.01 * 3.43 rad/s about y, which is toe up."""
    rotation = twist(feet(foot(x=0.01), foot()))[3:6]
    np.testing.assert_allclose(rotation, [0.0, -0.0343, 0.0], atol=EXACT)
    assert np.cross(rotation, [1.0, 0.0, 0.0])[2] > 0.0


def test_pressure_too_far_left_lifts_the_left_edge() -> None:
    """5 mm too far left: 0.02 * 1.715 rad/s about x."""
    rotation = twist(feet(foot(), foot(y=0.005)))[9:12]
    np.testing.assert_allclose(rotation, [0.0343, 0.0, 0.0], atol=EXACT)
    assert np.cross(rotation, [0.0, 1.0, 0.0])[2] > 0.0


def test_load_error_alone_does_not_turn_a_foot() -> None:
    """The desired moment is under the measured force."""
    desired = feet(foot(x=0.03, y=0.01), foot())
    measured = feet(foot(force=200.0, x=0.03, y=0.01), foot(force=486.0))
    result = twist(measured, desired)
    np.testing.assert_allclose(result[[3, 4, 5, 9, 10, 11]], 0.0, atol=EXACT)


def test_rotation_is_clamped_per_axis_both_ways() -> None:
    measured = feet(foot(x=0.12, y=0.07), foot(x=-0.12, y=-0.07))
    result = twist(measured)
    np.testing.assert_allclose(result[3:6], [0.2, -0.2, 0.0])
    np.testing.assert_allclose(result[9:12], [-0.2, 0.2, 0.0])


def test_foot_with_too_much_force_goes_up_against_the_other() -> None:
    """100 N more left than right, none desired: 1e-4 * 100 m/s apart."""
    result = twist(feet(foot(force=393.0), foot(force=293.0)))
    assert result[2] == pytest.approx(0.005)
    assert result[8] == pytest.approx(-0.005)


def test_vertical_speed_is_clamped() -> None:
    eager = ZmpSettings(dfz_admittance=5e-4, max_vertical_velocity_m_s=0.1)
    result = twist(feet(foot(force=686.0), foot(force=20.0)), settings=eager)
    assert (result[2], result[8]) == (0.1, -0.1)


def test_forces_are_compared_along_the_worlds_vertical() -> None:
    """Equal vertical loads on soles that tilt differently are equal loads."""
    R = [pin.rpy.rpyToMatrix(0.2, 0.1, 0.0), pin.rpy.rpyToMatrix(-0.1, 0.0, 0.3)]
    up = np.array([0.0, 0.0, HALF_WEIGHT])
    measured = np.concatenate((R[0].T @ up, np.zeros(3), R[1].T @ up, np.zeros(3)))
    result = twist(measured, measured, R_measured=R, R_commanded=R)
    np.testing.assert_allclose(result[[0, 1, 2, 6, 7, 8]], 0.0, atol=1e-9)
    upright = twist(measured, EVEN, R_measured=R)
    wanted_by_sole = (R[0][2] - R[1][2])[2] * HALF_WEIGHT
    assert upright[8] - upright[2] == pytest.approx(1e-4 * wanted_by_sole)


def test_tilted_commanded_sole_moves_along_the_worlds_vertical() -> None:
    R = [pin.rpy.rpyToMatrix(0.2, -0.3, 0.1), np.eye(3)]
    result = twist(feet(foot(force=393.0), foot(force=293.0)), R_commanded=R)
    np.testing.assert_allclose(R[0] @ result[:3], [0.0, 0.0, 0.005], atol=EXACT)


def test_drift_pulls_the_mean_height_back() -> None:
    """20 mm and 10 mm too high, 1 Hz: both sink at half of 30 mm/s."""
    result = twist(EVEN, lifted=(0.02, 0.01))
    assert result[2] == pytest.approx(-0.015)
    assert result[8] == pytest.approx(-0.015)


def test_height_stiffness_pulls_the_height_difference_back() -> None:
    stiff = ZmpSettings(dfz_damping=2.0, vdc_frequency=0.0)
    result = twist(EVEN, settings=stiff, lifted=(0.01, -0.01))
    # e_h = -0.02 m, parting = 0.04 m/s: the left foot goes down.
    assert result[2] == pytest.approx(-0.02)
    assert result[8] == pytest.approx(0.02)


def test_lifted_foot_seeks_the_ground_and_the_other_stands() -> None:
    """No force of the 50 N sought: 0.01 m/s down, no rotation."""
    result = twist(feet(foot(force=0.0), foot(force=686.0)), in_contact=RIGHT)
    np.testing.assert_allclose(result[:6], [0.0, 0.0, -0.01, 0.0, 0.0, 0.0])
    assert result[8] == 0.0


def test_in_the_air_no_foot_moves() -> None:
    nothing = feet(foot(force=0.0), foot(force=0.0))
    result = twist(nothing, nothing, in_contact=[False, False])
    np.testing.assert_array_equal(result, 0.0)
