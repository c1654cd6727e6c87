"""What all laws of motion share: their form, their fades, and how fast they may be."""

from __future__ import annotations

from collections.abc import Callable

from surefoot.schemas.motions import Motion
from surefoot.sim_robot.errors import ScenarioError
from surefoot.sim_robot.ticks import SIM_STEP_S

MotionLaw = Callable[[float], tuple[float, float]]
"""Time [s] to (position, velocity) in SI; at rest in zero until the motion starts."""
FASTEST_HZ = 0.5 / SIM_STEP_S
"""Half the simulation's rate: it does not show anything faster."""


def fade(u: float) -> tuple[float, float]:
    """Return the share of a motion that fades in, C2 smooth, and the share's slope.

    Args:
        u: from 0 to 1 over the fade.
    """
    share = u * u * u * (10.0 + u * (6.0 * u - 15.0))
    return share, 30.0 * u * u * (1.0 - u) * (1.0 - u)


def check_blend(motion: Motion) -> None:
    """Refuse a blend that would be over within a step of the simulation.

    Raises:
        ScenarioError: it is.
    """
    if motion.blend_s is not None and motion.blend_s < 1.0 / FASTEST_HZ:
        raise ScenarioError(
            f"blend_s: got {motion.blend_s:g} s, expected at least "
            f"{1.0 / FASTEST_HZ:g} s, two steps of the simulation",
            field="blend_s",
        )


def check_frequency(frequency_hz: float, key: str, *, what: str = "") -> None:
    """Refuse what is faster than half the simulation's rate.

    Args:
        frequency_hz: the fastest in the motion.
        key: of the motion that says so.
        what: in words, where the key is not the frequency itself.

    Raises:
        ScenarioError: it is.
    """
    if frequency_hz > FASTEST_HZ:
        raise ScenarioError(
            f"{key}: got {what or f'{frequency_hz:g} Hz'}, expected at most "
            f"{FASTEST_HZ:g} Hz, half the simulation's rate; slow it down",
            field=key,
        )
