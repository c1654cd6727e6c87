"""A step changes place and time so that place, time and DCM fit again."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from scipy.optimize import minimize

from surefoot.schemas.settings import WalkSettings
from surefoot.stabilizer.walking.footsteps import ANY_SPEED, Foothold
from surefoot.stabilizer.walking.gait import Gait
from surefoot.stabilizer.walking.phase_changes import is_over
from surefoot.stabilizer.walking.step_adjustment import StepAdjustment
from surefoot.stabilizer.walking.step_queue import Move

# Neither rate limit nor low-pass, so that one solution is seen at once.
SETTINGS = WalkSettings(adjust_rate_m_s=1e6, adjust_filter_s=1e-6)
KEPT_APART = msgspec.structs.replace(SETTINGS, cross_ahead_m=0.0)
SLOW = msgspec.structs.replace(SETTINGS, adjust_rate_m_s=2.0)
NEAREST_M = 0.17
HALF_SIZES = (0.135, 0.077)
DT, OMEGA = 1e-3, 3.8
SINGLE_S, DOUBLE_S, T = 0.6, 0.2, 0.2


class Step:
    """A step on the spot or ahead, at a time T in its single support."""

    def __init__(
        self,
        *,
        side: int = 0,
        ahead: float = 0.1,
        yaw: float = 0.0,
        turn: float = 0.0,
        settings: WalkSettings = SETTINGS,
        at: float = T,
        start: float = 0.22,
    ) -> None:
        self.own = 1.0 if side == 0 else -1.0
        across = 0.22 * self.own
        self.support = Foothold(1.0, 2.0, 0.0, yaw)
        self.move = Move(
            id=0,
            side=side,
            place=self.support.beside(ahead, across, turn),
            single_s=SINGLE_S,
            double_s=DOUBLE_S,
            height_m=0.05,
        )
        self.gait = Gait(settings, omega=OMEGA, com_offset=(0.0, 0.0), period_s=DT)
        self.gait.support = 1 - side
        self.gait.begin_single(self.move)
        feet = [self.support, self.support]
        feet[side] = self.move.place
        after = Move(1, 1 - side, self.support.beside(ahead * 2, 0.0), 0.6, 0.2, 0.05)
        self.gait.t = at - DT
        self.gait.advance(feet, [after])
        self.adjustment = StepAdjustment(
            settings,
            nearest=NEAREST_M,
            half_sizes=HALF_SIZES,
            leg_speed=ANY_SPEED,
            period_s=DT,
        )
        behind = self.support.beside(-ahead if start > 0.0 else -0.42, start * self.own)
        self.start = behind[:2]
        self.adjustment.begin(self.move, start=self.start, support=self.support)

    def push(self, ahead: float, left: float, *, least_s: float = 0.15) -> None:
        """Put the DCM off by a vector in the axes of the support."""
        cos, sin = math.cos(self.support.yaw), math.sin(self.support.yaw)
        self.adjustment.update(
            (cos * ahead - sin * left, sin * ahead + cos * left),
            self.move,
            gait=self.gait,
            support=self.support,
            least_left_s=lambda *_: least_s,
            foot=(self.foot, self.path),
        )

    @property
    def path(self) -> tuple[float, float]:
        """Return the foot's place without a shift, odometry frame."""
        part = min(self.gait.t / self.gait.duration_s, 1.0)
        place = self.move.place
        (x, y), (to_x, to_y) = self.start, (place.x, place.y)
        return x + part * (to_x - x), y + part * (to_y - y)

    @property
    def foot(self) -> tuple[float, float]:
        """Return the foot's place, odometry frame."""
        (x, y), (by_x, by_y) = self.path, self.adjustment.shift
        return x + by_x, y + by_y

    @property
    def beside_support(self) -> tuple[float, float]:
        """Return the foot's place ahead of the standing foot, and to its own side."""
        ahead, left, _ = Foothold(*self.foot, 0.0, 0.0).seen_from(self.support)
        return ahead, left * self.own

    @property
    def shift(self) -> tuple[float, float]:
        """Return the shift in the axes of the support."""
        x, y = self.adjustment.shift
        cos, sin = math.cos(self.support.yaw), math.sin(self.support.yaw)
        return cos * x + sin * y, cos * y - sin * x

    @property
    def left_s(self) -> float:
        return self.gait.duration_s - self.gait.t


def test_an_error_within_the_dead_band_changes_nothing() -> None:
    step = Step()
    step.push(0.019, -0.014)
    assert step.adjustment.shift == (0.0, 0.0)
    assert step.gait.duration_s == SINGLE_S


def test_an_error_that_the_ankles_can_end_changes_nothing() -> None:
    step = Step()
    step.push(0.05, 0.03)
    assert step.adjustment.shift == (0.0, 0.0)
    assert step.gait.duration_s == SINGLE_S


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_a_push_ahead_is_stepped_after(side: int, yaw: float) -> None:
    step = Step(side=side, yaw=yaw)
    step.push(0.12, 0.0)
    ahead, left = step.shift
    assert ahead > 0.05
    assert abs(left) < ahead / 2


@pytest.mark.parametrize("side", [0, 1])
def test_a_push_to_the_swing_side_is_stepped_after_sooner(side: int) -> None:
    outward = 1.0 if side == 0 else -1.0
    step = Step(side=side)
    step.push(0.0, 0.08 * outward)
    assert step.shift[1] * outward > 0.02
    assert step.left_s < SINGLE_S - T - 0.03


@pytest.mark.parametrize("side", [0, 1])
def test_feet_stay_apart_and_a_push_over_the_standing_foot_hurries_none(
    side: int,
) -> None:
    step = Step(side=side, settings=KEPT_APART)
    step.push(0.0, -0.15 * step.own)
    assert abs(step.shift[1]) <= 0.22 - NEAREST_M + 1e-6
    assert step.left_s >= SINGLE_S - T - 1e-6


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("yaw", [0.0, -2.5])
def test_a_dcm_beyond_the_standing_foot_is_stepped_after_across_it(
    side: int, yaw: float
) -> None:
    """Ahead of that foot first, so that the legs do not meet; and wholly across."""
    step = Step(side=side, yaw=yaw, settings=SLOW)
    passes = SLOW.cross_ahead_m
    seen = []
    while step.left_s > 0.0:
        step.gait.t += DT
        step.push(0.0, -0.15 * step.own, least_s=0.0)
        seen.append(step.beside_support)
    assert seen[-1][0] == pytest.approx(passes, abs=0.1)
    assert -NEAREST_M - 0.03 < seen[-1][1] <= -NEAREST_M + 1e-3
    on_its_way = [ahead for ahead, apart in seen if apart < NEAREST_M - 0.01]
    assert min(on_its_way) > passes - 0.03


@pytest.mark.parametrize("side", [0, 1])
def test_feet_that_have_crossed_part_again_behind_the_standing_one(side: int) -> None:
    step = Step(side=side, settings=SLOW, start=-NEAREST_M, at=DT)
    seen = []
    while step.left_s > 0.0:
        step.gait.t += DT
        step.push(0.0, 0.0, least_s=0.0)
        seen.append(step.beside_support)
    assert seen[-1] == pytest.approx((0.1, 0.22), abs=0.01)
    passing = [ahead for ahead, apart in seen if apart < NEAREST_M - 0.03]
    assert max(passing) < -2.0 * HALF_SIZES[0] - 0.05


@pytest.mark.parametrize("adjust", ["place", "off"])
def test_feet_cross_only_where_place_and_time_may_change(adjust: str) -> None:
    step = Step(settings=msgspec.structs.replace(SETTINGS, adjust=adjust))
    step.push(0.0, -0.15)
    assert abs(step.shift[1]) <= 0.22 - NEAREST_M + 1e-6


def test_a_shift_that_is_wanted_late_is_given_the_time_it_takes() -> None:
    """It was cut off 0.15 s before the touchdown, wherever the foot was by then."""
    step = Step(settings=msgspec.structs.replace(SLOW, adjust_rate_m_s=1.0), at=0.44)
    while step.left_s > 0.0:
        step.gait.t += DT
        step.push(-0.12, 0.0, least_s=0.0)
    assert step.shift[0] < -0.1


@pytest.mark.parametrize("turn", [0.3, -0.3])
def test_a_turned_foot_is_not_shifted_onto_the_other_one(turn: float) -> None:
    step = Step(ahead=0.0, turn=turn)
    step.push(0.0, -0.2)
    half_length, half_width = HALF_SIZES
    reaches = math.sin(abs(turn)) * half_length + math.cos(turn) * half_width
    assert step.shift[1] < 0.0
    assert 0.22 + step.shift[1] - reaches >= half_width


def test_a_leg_is_given_the_time_that_it_needs() -> None:
    step = Step()
    step.push(0.0, 0.1, least_s=0.37)
    assert step.left_s >= 0.37 - 1e-6


def test_a_single_support_is_made_longer_only_so_far() -> None:
    """However often it is solved again."""
    step = Step()
    for _ in range(800):
        step.gait.t += DT
        if step.left_s > 0.0:
            step.push(-0.12, -0.05, least_s=0.0)
    assert step.gait.duration_s <= SINGLE_S + SETTINGS.adjust_wait_s + 1e-6


def test_an_impact_that_shakes_the_dcm_changes_nothing() -> None:
    """100 mm for 6 ms; for 60 ms it is a push."""
    settings = msgspec.structs.replace(SETTINGS, adjust_filter_s=0.03)
    shaken, pushed = Step(settings=settings), Step(settings=settings)
    for step, ticks in ((shaken, 6), (pushed, 60)):
        for _ in range(ticks):
            step.push(0.1, 0.1)
    assert shaken.shift == (0.0, 0.0)
    assert pushed.shift[1] > 0.0
    assert pushed.left_s < shaken.left_s


def test_only_the_place_changes_when_only_that_may() -> None:
    step = Step(settings=msgspec.structs.replace(SETTINGS, adjust="place"))
    step.push(0.12, 0.05)
    assert step.shift[0] > 0.03
    assert step.gait.duration_s == pytest.approx(SINGLE_S)
    still = Step(settings=msgspec.structs.replace(SETTINGS, adjust="off"))
    still.push(0.12, 0.05)
    assert still.adjustment.shift == (0.0, 0.0)


@pytest.mark.parametrize("error", [(0.1, 0.03), (-0.06, 0.08), (0.09, -0.1)])
def test_it_is_the_least_departure_from_the_plan(error: tuple[float, float]) -> None:
    """Against a search without the QP, with place, time and offset as they are."""
    step = Step()
    gait, settings = step.gait, SETTINGS
    reference = np.subtract(gait.dcm, gait.zmp)
    beyond = np.sign(error) * np.maximum(np.abs(error) - settings.adjust_dead_m, 0.0)
    edge = np.array(HALF_SIZES) * settings.adjust_zmp_share
    if beyond[1] < 0.0:
        edge[1] = HALF_SIZES[1]
    growth = math.exp(OMEGA * (SINGLE_S - T))
    zmp = np.clip(beyond * growth / (growth - 1.0), -edge, edge)
    d = math.exp(-OMEGA * DOUBLE_S)
    g = (1.0 - d) / (OMEGA * DOUBLE_S)
    left_s = SINGLE_S - T

    def cost(unknowns: np.ndarray) -> float:
        shift, s = unknowns[:2], unknowns[2]
        planned = math.exp(OMEGA * left_s) * reference
        xi = zmp + s * math.exp(OMEGA * left_s) * (reference + beyond - zmp)
        off = (xi - planned - g * shift) / d
        return float(
            shift @ shift
            + settings.adjust_growth_m**2 * (s - 1.0) ** 2
            + settings.adjust_offset_weight**2 * off @ off
        )

    is_outward = (reference + beyond - zmp)[1] < 0.0
    soonest = 1.0 if is_outward else math.exp(OMEGA * (0.15 - left_s))
    best = minimize(
        cost,
        [0.0, 0.0, 1.0],
        method="L-BFGS-B",
        bounds=[
            (-0.25, 0.25),
            (NEAREST_M - 0.22, 0.2),
            (soonest, math.exp(OMEGA * settings.adjust_wait_s)),
        ],
        options={"ftol": 1e-15, "gtol": 1e-10},
    )
    step.push(*error)
    assert step.shift == pytest.approx(best.x[:2], abs=2e-4)
    assert step.left_s == pytest.approx(left_s + math.log(best.x[2]) / OMEGA, abs=1e-3)


@pytest.mark.parametrize("yaw", [0.0, 1.2])
@pytest.mark.parametrize(
    ("ahead", "left", "over"),
    [
        (0.0, 0.0, True),
        (0.15, 0.1, True),
        (0.3, 0.2, True),
        (0.3, 0.0, False),  # beside the way from sole to sole, within their rectangle
        (0.0, 0.2, False),
        (0.0, 0.08, True),
        (-0.14, 0.0, False),
        (0.44, 0.2, False),
    ],
)
def test_between_the_soles_is_what_lies_on_the_way_from_one_to_the_other(
    yaw: float, ahead: float, left: float, over: bool
) -> None:
    here = Foothold(1.0, 2.0, 0.0, yaw)
    there, at = here.beside(0.3, 0.2), here.beside(ahead, left)
    assert is_over(at[:2], here, there, half_sizes=HALF_SIZES) is over
    assert is_over(at[:2], there, here, half_sizes=HALF_SIZES) is over
