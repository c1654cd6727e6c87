"""A record once more: through a controller, or on a bus at its times."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from surefoot.playback.timeline import (
    Entry,
    Timeline,
    read_timeline,
    recorded_robot,
    to_wire,
)
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.replay_server import ReplayServer
from surefoot.schemas.errors import MessageError

if TYPE_CHECKING:
    from surefoot.playback.recompute import ReplayOutcome
    from surefoot.run_plan import Settings

LONGEST_NAP_S = 0.05
"""Longest sleep of a slow replay before it checks for a stop [s]."""
SHORTEST_NAP_S = 0.0005
"""Shorter waits are left out, and made up for later."""
LARGEST_LAG_S = 0.1
"""Lag beyond which a replay no longer catches up [s]."""


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
    # Messages go to a bus without any of this.
    from surefoot.playback.check import check, recorded_settings
    from surefoot.run_plan import resolve_settings

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


def between(
    timeline: Timeline, *, period_s: float, from_s: float, until_s: float | None
) -> list[Entry]:
    """Return the messages of a span of time."""
    first = timeline.first_tick + round(from_s / period_s)
    end = None if until_s is None else timeline.first_tick + round(until_s / period_s)
    return [
        entry
        for entry in timeline.entries
        if entry.tick >= first and (end is None or entry.tick < end)
    ]


def play(
    entries: Iterable[Entry],
    server: ReplayServer,
    *,
    raw: Callable[[str], bool],
    tick_s: float,
    stop: StopRequest,
    on_tick: Callable[[int], None],
) -> dict[str, int]:
    """Publish messages in their order, tick after tick.

    Returns:
        Messages played, by channel; what the record holds that is no message is
        passed over.
    """
    counts: dict[str, int] = {}
    for tick, said in _paced(entries, tick_s=tick_s, stop=stop):
        on_tick(tick)
        # Brought into form first, so that what belongs together leaves together.
        ready = []
        for entry in said:
            with contextlib.suppress(MessageError):
                data = to_wire(entry.data, is_raw=raw(entry.channel))
                ready.append((entry.channel, data))
        for channel, data in ready:
            server.publish(channel, data)
            counts[channel] = counts.get(channel, 0) + 1
    return counts


def _paced(
    entries: Iterable[Entry], *, tick_s: float, stop: StopRequest
) -> Iterator[tuple[int, list[Entry]]]:
    """Yield ticks with their messages, each at its time, until asked to stop."""
    before: tuple[int, int] | None = None
    due_s = time.monotonic()
    for (lap, tick), said in groupby(entries, key=lambda e: (e.round, e.tick)):
        if before is not None and before[0] == lap:
            due_s += (tick - before[1]) * tick_s
        before = (lap, tick)
        while (ahead_s := due_s - time.monotonic()) > SHORTEST_NAP_S:
            if stop.is_set:
                return
            # The pace of the record, in naps so short that a stop is soon seen.
            time.sleep(min(ahead_s, LONGEST_NAP_S))
        if stop.is_set:
            return
        due_s = max(due_s, time.monotonic() - LARGEST_LAG_S)
        yield tick, list(said)
