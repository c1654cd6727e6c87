"""Conventions of the simulation: MuJoCo's quaternions, whole steps, laws of motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.sim_robot.catalogue import ScenarioError

_FROM_WXYZ = np.array([1, 2, 3, 0])
_FROM_XYZW = np.array([3, 0, 1, 2])
SIM_STEP_S = 0.001
"""Simulation step [s]; a control period is a whole multiple of it."""
FASTEST_HZ = 0.5 / SIM_STEP_S
"""Half the simulation's rate [Hz]; it does not show anything faster."""
TOLERANCE_TICKS = 1e-6
MotionLaw = Callable[[float], tuple[float, float]]
"""Maps time [s] to position and velocity in SI; at rest at zero until it starts."""


def xyzw(quat_wxyz: Array) -> Array:
    """Put the scalar last.

    Args:
        quat_wxyz: (4,) in MuJoCo's order.

    Returns:
        (4,) in the order of bus and controller; a new array.
    """
    return quat_wxyz.take(_FROM_WXYZ)


def wxyz(quat_xyzw: Array) -> Array:
    """Put the scalar first, (4,) to (4,); the inverse of :func:`xyzw`."""
    return quat_xyzw.take(_FROM_XYZW)


def check_duration(duration_s: float, tick_s: float, *, what: str) -> None:
    """Refuse a run that is shorter than one tick.

    Raises:
        ScenarioError: it is.
    """
    if duration_s < (1.0 - TOLERANCE_TICKS) * tick_s:
        raise ScenarioError(
            f"{what}: got {duration_s:g} s, expected a tick of the robot or more, "
            f"{tick_s:g} s",
            field=what if what == "duration_s" else "",
        )


def whole_ticks(span_s: float, tick_s: float, *, what: str) -> int:
    """Convert a time span to whole ticks.

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
