"""Margins against closed formulas, and against the simulated loop."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot, make_robot
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.margins.linear_loop import LinearLoop
from surefoot.stabilizer.margins.margins import LoopMargins, compute_margins

DEFAULT = build_settings({}, overrides=[])
ENOUGH_DB = 6.0


@pytest.fixture(scope="module")
def loop(walker: Robot) -> LinearLoop:
    return LinearLoop(walker, DEFAULT)


def radius(loop: LinearLoop, delay_ticks: int, factor: float) -> float:
    A, B, C = loop.cut(delay_ticks)
    return float(np.abs(np.linalg.eigvals(A + factor * B @ C)).max())


def test_linear_loop_keeps_left_and_right_apart_by_mirror_only(
    loop: LinearLoop,
) -> None:
    A, B, C = loop.cut(1)
    step = np.linalg.solve(np.exp(0.3j) * np.eye(len(A)) - A, B)
    G = C @ step
    sign = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    mirror = np.block(
        [[np.zeros((6, 6)), np.diag(sign)], [np.diag(sign), np.zeros((6, 6))]]
    )
    assert np.abs(mirror @ G @ mirror - G).max() < 1e-3 * np.abs(G).max()


@pytest.fixture(scope="module")
def default(walker: Robot) -> LoopMargins:
    return compute_margins(walker, DEFAULT)


def test_gain_margin_is_where_the_closed_loop_begins_to_sway(
    default: LoopMargins, loop: LinearLoop
) -> None:
    gain_db = default.gain_db
    assert gain_db is not None
    factor = 10.0 ** (gain_db / 20.0)
    assert radius(loop, 1, 0.97 * factor) < 1.001
    assert radius(loop, 1, 1.03 * factor) > 1.002


def test_delays_shrink_the_gain_as_a_sampled_integrator(
    walker: Robot, default: LoopMargins
) -> None:
    """Gain k of an axis without dynamics: k dt < 2 sin(pi / (2 (2 d + 1)))."""
    limits = []
    for delay, found in (
        (1, default),
        (3, compute_margins(walker, DEFAULT, delay_ticks=3)),
    ):
        assert found.gain_db is not None
        bound = 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay + 1.0)))
        limits.append(10.0 ** (found.gain_db / 20.0) / bound)
    assert limits[0] == pytest.approx(limits[1], rel=0.1)


def test_default_gains_have_enough_margin_with_ideal_drives(
    default: LoopMargins,
) -> None:
    found = default
    assert found.worst_db is not None
    assert found.worst_db >= ENOUGH_DB
    assert found.disk > 0.0
    assert found.loop_delay_ms >= found.delay_ms
    assert found.missed_ticks > 0


def test_softer_feedback_has_more_margin_on_every_axis(
    walker: Robot, default: LoopMargins
) -> None:
    stiff = build_settings({}, overrides=["dik.k_force=-100"])
    after = compute_margins(walker, stiff)
    for one, other in zip(default.axes, after.axes, strict=True):
        assert one.gain_db is not None
        assert other.gain_db is not None
        assert other.gain_db > one.gain_db


def test_a_loop_that_sways_has_no_margins_and_says_what_it_lacks(walker: Robot) -> None:
    found = compute_margins(
        walker, build_settings({}, overrides=["dik.k_force=-15"]), delay_ticks=1
    )
    assert not found.stable
    assert found.gain_db is not None
    assert found.gain_db < 0.0
    assert found.missed_ticks == 0
    assert "has to grow" in found.in_words()[0]


def test_margins_do_not_change_with_the_order_of_joints(
    walker: Robot, default: LoopMargins
) -> None:
    turned = msgspec.structs.replace(walker.file, joint=walker.file.joint[::-1])
    other = make_robot(turned, path=walker.path, urdf_path=walker.urdf_path)
    found = compute_margins(other, DEFAULT)
    assert found.gain_db == pytest.approx(default.gain_db, abs=0.01)
    assert found.disk == pytest.approx(default.disk, abs=0.01)
