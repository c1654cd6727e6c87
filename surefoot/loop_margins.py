"""How far a robot's loops are from swaying, as a notebook asks for it."""

from __future__ import annotations

import math
from pathlib import Path

from surefoot.errors import UsageError
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.run_plan import Settings, resolve_settings
from surefoot.schemas.margins import LoopMargins
from surefoot.stabilizer.settings_check import check_settings

MS_PER_S = 1e3
MOST_TICKS = 100
_WHOLE = 1e-6


def compute_margins(
    robot: str | Path | Robot = "walker",
    *,
    servo_profile: str | None = None,
    settings: Settings = None,
    delay_ms: float | None = None,
) -> LoopMargins:
    """Compute what the whole-body stabilizer bears on a robot that stands.

    Args:
        robot: shipped name, path of a robot file, or a loaded robot.
        servo_profile: a profile of the robot file to use instead of its own; not of a
            robot that is loaded.
        settings: ``{"dik.k_force": -40.0}``, resolved settings, the name of shipped
            settings, a file, or None for the defaults.
        delay_ms: of the loop, from a reading to the step its answer acts in, a whole
            number of ticks; None for one tick [ms].

    Raises:
        UsageError: a delay that is no whole number of ticks.
        RobotFileError: no such robot.
        FileFormatError: a file or a setting is malformed.
    """
    if not isinstance(robot, Robot):
        robot = load_robot(str(robot), servo_profile=servo_profile)
    resolved = resolve_settings(settings)
    check_settings(resolved, robot)
    ticks = 1
    if delay_ms is not None:
        ticks = _ticks(delay_ms, robot.period_s)
    from surefoot.stabilizer.margins.margins import compute_margins as compute

    return compute(robot, resolved, delay_ticks=ticks)


def _ticks(delay_ms: float, period_s: float) -> int:
    exact = delay_ms / (MS_PER_S * period_s)
    ticks = round(exact) if math.isfinite(exact) else -1
    if not 0 <= ticks <= MOST_TICKS or abs(exact - ticks) > _WHOLE:
        raise UsageError(
            f"delay: got {delay_ms:g} ms, expected a whole number of ticks of "
            f"{MS_PER_S * period_s:g} ms, 0 to {MOST_TICKS} of them"
        )
    return ticks
