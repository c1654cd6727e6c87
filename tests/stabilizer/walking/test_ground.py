"""The expected ground of a swing foot."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.estimation.contact import Anchors
from surefoot.stabilizer.walking.ground import ExpectedGround

HALF_SIZES = ((0.13, 0.08), (0.13, 0.08))
DT, TURN_RAD_S, WEIGHT_N = 1e-3, 0.5, 690.0
CLOSE_RAD = 0.01


def stand_on_one_foot(
    *, pressed_at: float, ticks: int = 300, left_turns: float = 1.0
) -> tuple[Any, Any]:
    """Roll the right sole under all of the weight; return ground and dynamics.

    Args:
        pressed_at: centre of pressure, from the sole's middle (0) to its edge (1).
        ticks: duration.
        left_turns: rotation of the left sole over that of the right one, while both
            stood.
    """
    ground = ExpectedGround(WalkSettings(), half_sizes=HALF_SIZES, period_s=DT)
    dynamics: Any = SimpleNamespace(
        R_world_sole=[np.eye(3), np.eye(3)],
        p_sole=[np.array([0.0, 0.11, 0.05]), np.array([0.0, -0.11, 0.0])],
    )
    law: Any = SimpleNamespace(share=[0.0, 1.0], ground_twist=np.zeros(12))
    law.ground_twist[[3, 9]] = left_turns * TURN_RAD_S, TURN_RAD_S
    F = np.zeros(12)
    F[[2, 8]] = 0.5 * WEIGHT_N
    dynamics.v_sole = np.zeros(12)
    for _ in range(500):
        ground.update(dynamics, law, F, feet=SimpleNamespace(arriving=None, states=[]))  # type: ignore[arg-type]
    F[2] = 0.0
    ground.stand_on(dynamics, support=1)
    for tick in range(ticks):
        F[8], F[9] = WEIGHT_N, WEIGHT_N * pressed_at * HALF_SIZES[1][1]
        roll = TURN_RAD_S * DT * (tick + 1)
        dynamics.R_world_sole[1] = Rotation.from_euler("x", roll).as_matrix()
        ground.from_one(dynamics, law, F, support=1)
    return ground, dynamics


@pytest.mark.parametrize("pressed_at", [0.0, -0.9])
def test_ground_turns_with_a_sole_that_lies_on_it(pressed_at: float) -> None:
    ground, dynamics = stand_on_one_foot(pressed_at=pressed_at)
    sole = dynamics.R_world_sole[1][:, 2]
    assert np.arccos(np.clip(ground.normal @ sole, -1.0, 1.0)) < CLOSE_RAD


@pytest.mark.parametrize("left_turns", [0.0, -1.0, 0.2])
def test_a_sole_that_turned_without_the_other_turns_on_a_stone(
    left_turns: float,
) -> None:
    """Its pressure may be anywhere: stones have edges of their own."""
    ground, _ = stand_on_one_foot(pressed_at=0.0, left_turns=left_turns)
    assert ground.normal[2] > np.cos(CLOSE_RAD)
    assert abs(ground.velocity) < CLOSE_RAD


def test_soles_at_rest_have_shown_no_ground_that_turns() -> None:
    """What they turn by then is noise, however alike."""
    ground = ExpectedGround(WalkSettings(), half_sizes=HALF_SIZES, period_s=DT)
    soles: Any = SimpleNamespace(
        R_world_sole=[np.eye(3), np.eye(3)],
        p_sole=[np.array([0.0, 0.11, 0.0]), np.array([0.0, -0.11, 0.0])],
        v_sole=np.zeros(12),
    )
    law: Any = SimpleNamespace(share=[1.0, 1.0], ground_twist=np.zeros(12))
    feet: Any = SimpleNamespace(arriving=None, states=[])
    F = np.full(12, 0.5 * WEIGHT_N)
    for tick in range(2000):
        law.ground_twist[[3, 9]] = 0.003 * (-1.0) ** tick
        ground.update(soles, law, F, feet=feet)
    assert ground.turns == 0.0


def test_a_sole_that_tips_over_its_edge_is_no_ground() -> None:
    ground, _ = stand_on_one_foot(pressed_at=1.0)
    level = np.arccos(np.clip(ground.normal[2], -1.0, 1.0))
    assert level < 0.15 * TURN_RAD_S * 0.3


@pytest.mark.parametrize(("other_deg", "is_believed"), [(0.5, True), (8.0, False)])
def test_two_pressed_soles_are_believed_as_far_as_they_agree(
    other_deg: float, is_believed: bool
) -> None:
    """One foot lands, both are pressed at an edge: a platform, or stones."""
    roll = np.radians(6.0)
    left = Rotation.from_euler("x", roll).as_matrix()
    right = Rotation.from_euler("x", roll - np.radians(other_deg)).as_matrix()
    soles: Any = SimpleNamespace(
        R_world_sole=[left, right],
        p_sole=[left @ [0.0, 0.11, 0.0], left @ [0.0, -0.11, 0.0]],
        v_sole=np.zeros(12),
    )
    law: Any = SimpleNamespace(share=[1.0, 1.0], ground_twist=np.zeros(12))
    F = np.zeros(12)
    F[2], F[8] = 0.6 * WEIGHT_N, 0.4 * WEIGHT_N
    F[3], F[9] = F[2] * HALF_SIZES[0][1], F[8] * HALF_SIZES[1][1]
    ground = ExpectedGround(WalkSettings(), half_sizes=HALF_SIZES, period_s=DT)
    feet: Any = SimpleNamespace(arriving=1, states=[])
    for _ in range(200):
        ground.update(soles, law, F, feet=feet)
    off = np.arccos(np.clip(ground.normal @ left[:, 2], -1.0, 1.0))
    assert bool(off < np.radians(0.6)) is is_believed


def two_feet(*, rise: float, tilts_deg: tuple[float, float] = (0.0, 0.0)) -> Any:
    """Soles 0.3 m behind each other, pitched [deg], the left one higher [m]."""
    R = [Rotation.from_euler("y", np.radians(t)).as_matrix() for t in tilts_deg]
    places = [np.array([0.3, 0.11, rise]), np.array([0.0, -0.11, 0.0])]
    return SimpleNamespace(R_world_sole=R, p_sole=places, v_sole=np.zeros(12))


PITCH = float(np.radians(5.0))


@pytest.mark.parametrize(
    ("soles", "level", "found"),
    [
        (two_feet(rise=0.02), 0.0, 0.02),
        (two_feet(rise=-0.02), 0.0, -0.02),
        (two_feet(rise=0.02, tilts_deg=(3.0, -4.0)), 0.0, 0.02),
        (two_feet(rise=0.17), 0.15, 0.02),
        (two_feet(rise=0.15), 0.15, 0.0),
        (two_feet(rise=0.002), 0.0, 0.0),
        (two_feet(rise=-0.3 * np.tan(PITCH), tilts_deg=(5.0, 5.0)), 0.0, 0.0),
    ],
    ids=["up", "down", "tilted", "off the plan", "as planned", "noise", "slope"],
)
def test_a_foothold_that_is_not_at_its_planned_height_is_found(
    soles: Any, level: float, found: float
) -> None:
    ground = ExpectedGround(WalkSettings(), half_sizes=HALF_SIZES, period_s=DT)
    anchors = Anchors([np.zeros(3), np.zeros(3)], [0.0, 0.0])
    anchors.level[0] = level
    anchors.relief[1] = 0.01  # that of the foot behind, from before
    F = np.zeros(12)
    for _ in range(500):  # a foot that carries nothing shows no ground
        ground.find_relief(soles, F, anchors, moved=0)
    assert anchors.relief == [0.0, 0.01]
    F[[2, 8]] = 0.5 * WEIGHT_N
    for _ in range(500):
        ground.find_relief(soles, F, anchors, moved=0)
    assert anchors.relief == pytest.approx([0.01 + found, 0.01], abs=0.001)


def test_the_ground_under_a_tipping_sole_is_at_its_pressed_edge() -> None:
    """The heel rises as the foot rolls off: the ground does not."""
    ground = ExpectedGround(WalkSettings(), half_sizes=HALF_SIZES, period_s=DT)
    anchors = Anchors([np.zeros(3), np.zeros(3)], [0.0, 0.0])
    length, pitch = HALF_SIZES[1][0], np.radians(8.0)
    soles = two_feet(rise=0.02, tilts_deg=(0.0, 8.0))
    soles.p_sole[1][2] = length * np.sin(pitch)  # about its front edge, at zero
    F = np.zeros(12)
    F[[2, 8]] = 0.5 * WEIGHT_N
    F[10] = -F[8] * length
    for _ in range(500):
        ground.find_relief(soles, F, anchors, moved=0)
    assert anchors.relief[0] == pytest.approx(0.02, abs=0.001)
