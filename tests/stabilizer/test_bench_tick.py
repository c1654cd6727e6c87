"""The tick benchmark finds each stage by its name, and fails when one is renamed."""

from __future__ import annotations

from benchmarks import bench_tick

STAGES = ("controller tick", "estimator", "dynamics", "TSID", "wrench law", "DIK")
TICKS = bench_tick.WARM_UP_TICKS + 400
"""Longer than the benchmark's warm-up, which begins after the calibration."""


def test_every_stage_is_timed() -> None:
    table = bench_tick.run("standing", ticks=TICKS)
    medians = {line[:26].strip(): float(line[26:35]) for line in table.splitlines()[1:]}
    assert {*STAGES, "command gate", "plant: step"} <= set(medians)
    assert all(median > 0.0 for median in medians.values())
