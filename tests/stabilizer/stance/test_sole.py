"""The rectangle of a sole is found from the foot's shape, however it is modelled."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from surefoot.robot_io.errors import RobotFileError
from surefoot.stabilizer.stance.sole import fit_sole

TOLERANCE_M = 1e-5
UP, AHEAD = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def box(half: tuple[float, float, float], centre: tuple[float, float, float]):  # type: ignore[no-untyped-def]
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    return signs * half + centre


def test_of_a_box_it_is_the_lower_face() -> None:
    sole = fit_sole(box((0.12, 0.05, 0.02), (0.03, 0.1, -0.8)), up=UP, ahead=AHEAD)
    assert sole.half_length == pytest.approx(0.12, abs=TOLERANCE_M)
    assert sole.half_width == pytest.approx(0.05, abs=TOLERANCE_M)
    np.testing.assert_allclose(sole.centre, [0.03, 0.1, -0.82], atol=TOLERANCE_M)
    np.testing.assert_allclose(sole.R, np.eye(3), atol=TOLERANCE_M)


@pytest.mark.parametrize("seed", range(5))
def test_it_turns_with_the_foot(seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    points = box((0.12, 0.05, 0.02), (0.03, 0.1, -0.8)) @ turn.T
    sole = fit_sole(points, up=turn @ UP, ahead=turn @ AHEAD)
    assert sole.half_length == pytest.approx(0.12, abs=TOLERANCE_M)
    np.testing.assert_allclose(turn.T @ sole.R, np.eye(3), atol=TOLERANCE_M)


def test_of_a_tapered_foot_all_corners_touch_the_ground() -> None:
    outline = np.array([[-0.1, 0.03], [-0.1, -0.03], [0.15, 0.06], [0.15, -0.06]])
    points = np.vstack([np.column_stack((outline, np.full(4, z))) for z in (0, 0.1)])
    sole = fit_sole(points, up=UP, ahead=AHEAD)
    back = sole.centre[0] - sole.half_length
    assert back >= -0.1 - TOLERANCE_M
    assert sole.centre[0] + sole.half_length <= 0.15 + TOLERANCE_M
    assert sole.half_width <= 0.03 + 0.12 * (back + 0.1) + TOLERANCE_M
    assert 0.6 < sole.share < 1.0


def test_of_three_studs_it_is_half_of_what_they_span() -> None:
    studs = np.array([[-0.1, 0.06], [-0.1, -0.06], [0.15, 0.0]])
    points = np.vstack([np.column_stack((studs, np.full(3, z))) for z in (0, 0.1)])
    sole = fit_sole(points, up=UP, ahead=AHEAD)
    assert sole.share == pytest.approx(0.5, abs=1e-4)
    assert sole.half_length == pytest.approx(0.0625, abs=TOLERANCE_M)


@pytest.mark.parametrize("corners", [3, 4, 7])
@pytest.mark.parametrize("seed", range(10))
def test_whatever_the_outline_the_rectangle_lies_inside(
    corners: int, seed: int
) -> None:
    jitter = np.random.default_rng(seed).uniform(0.0, 0.6, corners)
    angles = (np.arange(corners) + jitter) * 2.0 * np.pi / corners
    outline = np.column_stack((0.2 * np.cos(angles), 0.1 * np.sin(angles)))
    points = np.vstack(
        [np.column_stack((outline, np.full(corners, z))) for z in (0, 0.1)]
    )
    sole = fit_sole(points, up=UP, ahead=AHEAD)
    hull = ConvexHull(outline)
    half = np.array((sole.half_length, sole.half_width))
    signs = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    at = sole.centre[:2] + signs * half
    assert (hull.equations[:, :2] @ at.T + hull.equations[:, 2:]).max() < TOLERANCE_M


def test_four_studs_hold_the_rectangle_between_them() -> None:
    corners = np.array([[-0.05, -0.03], [-0.05, 0.03], [0.12, -0.03], [0.12, 0.03]])
    points = np.vstack(
        [np.column_stack((corners, np.full(4, z))) for z in (-0.005, 0.005)]
    )
    sole = fit_sole(points, up=UP, ahead=AHEAD)
    assert sole.half_length == pytest.approx(0.085, abs=TOLERANCE_M)
    assert sole.half_width == pytest.approx(0.03, abs=TOLERANCE_M)


def test_a_foot_that_stands_on_an_edge_is_refused() -> None:
    edge = np.array([[x, 0.0, 0.0] for x in (-0.1, 0.1)])
    top = np.array([[x, y, 0.1] for x in (-0.1, 0.1) for y in (-0.05, 0.05)])
    with pytest.raises(RobotFileError, match=r"no face|edge"):
        fit_sole(np.vstack((edge, top)), up=UP, ahead=AHEAD)
