"""A record through a controller again, as one call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from surefoot.playback.check import check, recorded_settings
from surefoot.playback.recompute import ReplayOutcome
from surefoot.playback.timeline import read_timeline, recorded_robot
from surefoot.robot_io.robot import Robot
from surefoot.run_plan import Settings, resolve_settings

__all__ = ["ReplayOutcome", "replay"]


def replay(
    file: str | Path,
    *,
    controller: str | None = None,
    settings: Settings = None,
    robot: str | Path | Robot | None = None,
    until_s: float | None = None,
    on_tick: Callable[[int], None] | None = None,
) -> ReplayOutcome:
    """Compute the commands of a record again from its sensors, and compare.

    The robot does not follow the new commands: every tick has the sensors that were
    recorded.

    Args:
        file: a record (.mcap), or the folder of a run that holds one.
        controller: a name as on the command line; None for the recorded one.
        settings: see :func:`surefoot.simulate`; None for those of the record.
        robot: None for the one that is attached to the record.
        until_s: compare this much from the first tick [s]; None for all.
        on_tick: called with each tick.

    Returns:
        What was compared, and the first command that differs, bit for bit.

    Raises:
        UsageError: no such file, or it holds nothing to compute again.
        ControllerError: no such controller.
    """
    path = Path(file)
    if path.is_dir():
        path /= "run.mcap"
    timeline = read_timeline(path)
    resolved = (
        recorded_settings(timeline, [])
        if settings is None
        else resolve_settings(settings)
    )
    instead = str(robot.path) if isinstance(robot, Robot) else robot
    with recorded_robot(
        timeline.record, None if instead is None else str(instead)
    ) as model:
        return check(
            timeline,
            model,
            resolved,
            file=path,
            law=controller,
            until_s=until_s,
            on_tick=on_tick or _unheard,
        )


def _unheard(tick: int) -> None:
    del tick
