"""Time spans as whole numbers of ticks."""

from __future__ import annotations

from surefoot.sim_robot.errors import ScenarioError

SIM_STEP_S = 0.001
"""Simulation step [s]; a control period is a whole multiple of it."""
TOLERANCE_TICKS = 1e-6


def whole_ticks(span_s: float, tick_s: float, *, what: str) -> int:
    """Convert a time span to whole ticks.

    Args:
        span_s: the span [s].
        tick_s: one tick [s].
        what: named in the error.

    Raises:
        ScenarioError: the span is not a whole multiple of the tick.
    """
    ticks = round(span_s / tick_s)
    if abs(span_s - ticks * tick_s) > TOLERANCE_TICKS * tick_s:
        raise ScenarioError(
            f"{what}: got {1e3 * span_s:g} ms, expected a whole multiple of "
            f"{1e3 * tick_s:g} ms",
            field=what,
        )
    return ticks
