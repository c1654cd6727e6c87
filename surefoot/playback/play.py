"""Plays a record back: its messages on a bus at their times."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import groupby

from surefoot.playback.timeline import Entry, Timeline, to_wire
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot_side.replay_server import ReplayServer
from surefoot.schemas.errors import MessageError

LONGEST_NAP_S = 0.05
"""Longest sleep of a slow replay before it checks for a stop [s]."""
SHORTEST_NAP_S = 0.0005
"""Shorter waits are left out, and made up for later."""
LARGEST_LAG_S = 0.1
"""Lag beyond which a replay no longer catches up [s]."""


def between(
    timeline: Timeline, *, period_s: float, from_s: float, until_s: float | None
) -> list[Entry]:
    """Return the messages of a span of time.

    Args:
        timeline: the whole record.
        period_s: of a tick [s].
        from_s: begin, counted from the first tick of the record [s].
        until_s: end, counted the same way; None for all [s].
    """
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

    Args:
        entries: in order.
        server: the bus.
        raw: whether a channel holds the bytes of the bus.
        tick_s: time from tick to tick [s].
        stop: ends it.
        on_tick: called with each tick before it is played.

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
