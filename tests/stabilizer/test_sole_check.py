"""A moment that suddenly presses outside of its sole is false."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout
from surefoot.schemas.reasons import SensorTrouble
from surefoot.schemas.sensors import SENSORS
from surefoot.schemas.settings import SafetySettings
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.safety.consistency import NEITHER, SoleCheck
from surefoot.stabilizer.safety.health import (
    FRESH,
    LEFT_FT,
    REQUIRED,
    RIGHT_FT,
    SensorHealth,
)
from tests.stabilizer.test_wrench_compensation import felt_by_the_sensor

MARGIN = 0.02
LEVEL = np.eye(3)
ROLL, PITCH = 3, 4
both_axes = pytest.mark.parametrize("axis", [ROLL, PITCH], ids=["roll", "pitch"])
both_feet = pytest.mark.parametrize("side", [0, 1], ids=["left", "right"])


def reading(
    model: RobotModel, *, place: tuple[float, float] = (0.0, 0.0), load: float = 0.5
) -> Snapshot:
    """Return the readings of feet that both press at one place of their soles.

    Args:
        model: the robot.
        place: along roll and pitch; 1 is the sole's edge.
        load: of each foot, as a part of the robot's weight.
    """
    layout = SnapshotLayout(model.n_a)
    snapshot = layout.view(0, 0, np.zeros(layout.size))
    feet = []
    for side, (half_length, half_width) in enumerate(model.half_sizes):
        force = load * model.weight
        moment = [force * half_width * place[0], force * half_length * place[1], 0.0]
        wrench = np.array([0.0, 0.0, force, *moment])
        feet.append(felt_by_the_sensor(model, wrench, R_world_sole=LEVEL, side=side))
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    return replace(snapshot, ft_left=feet[0], ft_right=feet[1], quat_xyzw=upright)


def with_false_moment(
    snapshot: Snapshot, model: RobotModel, side: int, axis: int, moment: float
) -> Snapshot:
    """Return a reading with an error of one foot's moment about an axis."""
    error = np.zeros(6)
    error[3:] = moment * model.T_sensor_sole[side].rotation[:, axis - ROLL]
    if side == 0:
        return replace(snapshot, ft_left=snapshot.ft_left + error)
    return replace(snapshot, ft_right=snapshot.ft_right + error)


def edge(model: RobotModel, axis: int) -> float:
    """Return the moment of a foot that carries half of the robot at its edge [N m]."""
    half_length, half_width = model.half_sizes[0]
    return 0.5 * model.weight * (half_width if axis == ROLL else half_length)


@both_feet
@both_axes
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_moment_that_jumps_over_the_edge_names_its_foot(
    model: RobotModel, side: int, axis: int, sign: float
) -> None:
    check, still = SoleCheck(model, margin=MARGIN), reading(model)
    assert check.outside(still) == NEITHER
    moment = sign * (edge(model, axis) + 1.5 * MARGIN * 0.5 * model.weight)
    wrong = with_false_moment(still, model, side, axis, moment)
    for _ in range(3):  # as long as it lasts
        assert check.outside(wrong) == (side == 0, side == 1)
    assert check.outside(still) == NEITHER


@both_axes
def test_all_that_a_sole_can_report_is_believed(model: RobotModel, axis: int) -> None:
    check = SoleCheck(model, margin=MARGIN)
    rng = np.random.default_rng(3)
    for _ in range(200):  # from tick to tick as different as can be
        place = tuple(rng.uniform(-1.0, 1.0, 2))
        load = float(rng.choice([0.0, 0.05, 0.5, 1.0, 4.0]))
        assert check.outside(reading(model, place=place, load=load)) == NEITHER


@both_axes
def test_an_offset_of_the_sensor_shows_at_the_edge_and_is_believed(
    model: RobotModel, axis: int
) -> None:
    """A foot that tips takes its pressure to the edge in some ten milliseconds."""
    check = SoleCheck(model, margin=MARGIN)
    offset = 0.4 * edge(model, axis)
    for share in np.linspace(0.0, 1.0, 30):
        place = (share, 0.0) if axis == ROLL else (0.0, share)
        tipping = reading(model, place=place)
        assert (
            check.outside(with_false_moment(tipping, model, 1, axis, offset)) == NEITHER
        )


@both_axes
def test_a_blow_against_the_foot_is_believed(model: RobotModel, axis: int) -> None:
    """It may hit above the sole, as a wall does; a false moment brings no force."""
    check, still = SoleCheck(model, margin=MARGIN), reading(model)
    assert check.outside(still) == NEITHER
    moment = 1.4 * edge(model, axis)
    hit = with_false_moment(still, model, 0, axis, moment)
    blow = np.zeros(6)
    blow[:3] = -model.weight * model.T_sensor_sole[0].rotation[:, 0]
    assert check.outside(replace(hit, ft_left=hit.ft_left + blow)) == NEITHER


@both_axes
def test_a_doubted_foot_must_come_well_within(model: RobotModel, axis: int) -> None:
    check = SoleCheck(model, margin=MARGIN)
    doubted, half = (True, False), 0.5 * edge(model, axis)
    # An impact would excuse any moment; so more than the weight does not count.
    for load, limit in ((0.5, half), (1.0, 2.0 * half), (5.0, 2.0 * half)):
        pressed = reading(model, load=load)
        wrong = with_false_moment(pressed, model, 0, axis, 1.3 * limit)
        assert check.outside(wrong, doubted) == doubted
        right = with_false_moment(pressed, model, 0, axis, 0.9 * limit)
        assert check.outside(right, doubted) == NEITHER


@both_axes
def test_a_moment_that_is_false_from_the_first_reading_on_is_told(
    model: RobotModel, axis: int
) -> None:
    check = SoleCheck(model, margin=MARGIN)
    moment = edge(model, axis) + 1.5 * MARGIN * 0.5 * model.weight
    wrong = with_false_moment(reading(model), model, 0, axis, moment)
    assert check.outside(wrong) == (True, False)


@both_axes
def test_a_moment_that_flips_its_sign_is_told(model: RobotModel, axis: int) -> None:
    check = SoleCheck(model, margin=MARGIN)
    tipping = reading(model, place=(1.0, 0.0) if axis == ROLL else (0.0, 1.0))
    assert check.outside(tipping) == NEITHER
    moment = -2.0 * edge(model, axis) - 1.5 * MARGIN * 0.5 * model.weight
    wrong = with_false_moment(tipping, model, 0, axis, moment)
    assert check.outside(wrong) == (True, False)


@both_axes
@pytest.mark.parametrize(("of_forces", "of_moments"), [(0.85, 1.0), (1.0, 1.2)])
def test_a_sensor_with_a_wrong_scale_may_feel_an_impact(
    model: RobotModel, axis: int, of_forces: float, of_moments: float
) -> None:
    check = SoleCheck(model, margin=MARGIN)
    scale = np.array([of_forces] * 3 + [of_moments] * 3)
    place = (1.0, 0.0) if axis == ROLL else (0.0, 1.0)
    for load in (0.0, 1.0, 5.0, 2.0, 0.0):
        felt = reading(model, place=place, load=load)
        scaled = replace(
            felt, ft_left=felt.ft_left * scale, ft_right=felt.ft_right * scale
        )
        assert check.outside(scaled) == NEITHER


def test_a_tick_without_numbers_hides_no_jump(model: RobotModel) -> None:
    check, still = SoleCheck(model, margin=MARGIN), reading(model)
    check.outside(still)
    assert check.outside(replace(still, ft_left=np.full(6, np.nan))) == NEITHER
    wrong = with_false_moment(still, model, 0, ROLL, 2.0 * edge(model, ROLL))
    assert check.outside(wrong) == (True, False)


def test_the_last_possible_moment_is_used_until_the_sensor_is_lost(
    model: RobotModel,
) -> None:
    settings = SafetySettings()
    soles = SoleCheck(model, margin=settings.sole_margin_m)
    health = SensorHealth(model.robot, settings, soles=soles)
    still = reading(model)
    health.check(still, FRESH, moves=lambda: False)
    wrong = with_false_moment(still, model, 1, ROLL, 2.0 * edge(model, ROLL))
    for _ in range(round(settings.bridge_s / model.robot.period_s)):
        believed = health.check(wrong, FRESH, moves=lambda: False)
        assert np.array_equal(believed.ft_right, still.ft_right)
        assert health.all_believed
    health.check(wrong, FRESH, moves=lambda: False)
    assert health.lost[RIGHT_FT] is SensorTrouble.INCONSISTENT
    assert health.in_words() == f"{SENSORS[RIGHT_FT].name} inconsistent"
    assert health.lost[LEFT_FT] is None
    assert not any(health.lost[index] for index in REQUIRED)
