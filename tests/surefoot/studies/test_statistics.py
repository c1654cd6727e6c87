"""Success rates, their intervals and limits."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.studies.cell import Group
from surefoot.studies.summaries import (
    GroupSummary,
    curves_over,
    short_name,
    success_interval,
    success_limit,
    value_in_words,
    write_summary,
)

TOLERANCE = 1e-4


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [(50, 50, 0.9287, 1.0), (0, 50, 0.0, 0.0713), (5, 10, 0.2366, 0.7634)],
)
def test_interval_is_wilsons(
    successes: int, runs: int, low: float, high: float
) -> None:
    interval = success_interval(successes, runs)
    assert interval == pytest.approx((low, high), abs=TOLERANCE)


def test_nothing_tried_says_nothing() -> None:
    assert success_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("rates", "limit"),
    [
        ([1.0, 1.0, 0.0], 150.0),
        ([1.0, 0.25, 0.0], 60.0 + 60.0 * 0.5 / 0.75),
        ([0.0, 0.0, 0.0], 60.0),
        ([1.0, 0.75, 0.5], None),
    ],
)
def test_limit_lies_where_half_the_runs_fall(
    rates: list[float], limit: float | None
) -> None:
    assert success_limit([60.0, 120.0, 180.0], rates) == (
        None if limit is None else pytest.approx(limit)
    )


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("tilt-sine-roll", "tilt-sine-roll"),
        ("../of mine/my.ground.toml", "my.ground"),
        ("zmp-tuned", "zmp-tuned"),
        ("work/own.py:MyController", "MyController"),
        ("package.module:Law", "Law"),
    ],
)
def test_plots_name_things_without_their_folders(name: str, shown: str) -> None:
    assert short_name(name) == shown


def test_curves_are_over_numbers_where_lists_are_varied_too(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    name = "sensors.force_bias_n"
    groups = {
        Group("standing", ((name, bias),), "hold", "ideal"): GroupSummary(
            runs=1, up=1, up_from=0.2, up_to=1.0
        )
        for bias in (5.0, (0.0, 0.0, 5.0))
    }
    (curve,) = curves_over(groups, scenario="standing", name=name)
    assert curve.levels == (5.0,)
    write_summary(tmp_path, groups)


def test_plots_keep_apart_what_only_folders_tell_apart(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    laws = ("a/own.py:Law", "b/own.py:Law")
    groups = {
        Group(scenario, (("friction", friction),), law, "ideal"): GroupSummary(
            runs=1, up=int(law == laws[0]), up_from=0.0, up_to=1.0
        )
        for scenario in ("old/ramp.toml", "new/ramp.toml", "standing")
        for friction in (0.4, 0.7)
        for law in laws
    }
    curves = curves_over(groups, scenario="standing", name="friction")
    assert [(c.label, c.rates) for c in curves] == [
        ("a/own.py:Law, ideal", (1.0, 1.0)),
        ("b/own.py:Law, ideal", (0.0, 0.0)),
    ]
    write_summary(tmp_path, groups)
    assert sorted(path.name for path in tmp_path.glob("*.svg")) == [
        "success-new-ramp-friction.svg",
        "success-old-ramp-friction.svg",
        "success-standing-friction.svg",
    ]


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("platform.0.motion.1.amplitude_deg", "platform 0 motion 1: amplitude [deg]"),
        ("platform.*.motion.*.rate_m_s", "platform all motion all: rate [m/s]"),
        ("push.0.impulse_n_s", "push 0: impulse [N s]"),
        ("tilt_rate_deg_s", "tilt rate [deg/s]"),
        ("sensors.accel_noise_m_s2", "sensors: accel noise [m/s²]"),
        ("delay.sensor_ms.imu", "delay sensor: imu [ms]"),
        ("sensors.force_bias_n.left.2", "sensors force bias left: 2 [N]"),
        ("friction", "friction"),
    ],
)
def test_axes_are_named_in_words_with_units(path: str, words: str) -> None:
    assert value_in_words(path) == words
