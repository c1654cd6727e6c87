"""Watches the two processes of a run and finds whose failure ended it."""

from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue

from surefoot.errors import ChildFailedError
from surefoot.exit_codes import ExitCode
from surefoot.processes.child import Child, Event, Exit, Progress

_PARTNER_S = 10.0
"""Time for the second process to end after the first has ended well [s]."""
_CAUSE_S = 2.0
"""Time after the stabilizer's failure in which the robot's own still counts [s]."""
_WELL = (ExitCode.OK, ExitCode.FELL)


def supervise(
    robot: Child,
    stabilizer: Child,
    *,
    events: SimpleQueue[Event],
    on_tick: Callable[[int], None],
    between: Child | None = None,
) -> None:
    """Wait until both processes have ended by themselves.

    Args:
        robot: the robot's process; it is what ends a run.
        stabilizer: the stabilizer's process.
        events: of both.
        on_tick: called with the robot's tick.
        between: a relay, without which the two cannot go on.

    Raises:
        ChildFailedError: one failed, or did not end after the other; the message
            holds its last words. The robot's own failure is named first, since the
            stabilizer's may only follow from it; a relay's before both.
    """
    codes: dict[str, int] = {}
    until: float | None = None
    while len(codes) < 2:
        try:
            event = events.get(timeout=None if until is None else _left(until))
        except Empty:
            break
        if isinstance(event, Progress):
            on_tick(event.tick)
            if until is not None and all(code in _WELL for code in codes.values()):
                until = time.monotonic() + _PARTNER_S  # held in order: it goes on
            continue
        if isinstance(event, Exit) and event.child is between:
            raise failure(event.child, event.code)
        if not isinstance(event, Exit) or event.child not in (robot, stabilizer):
            continue  # recorder and page may come and go
        codes[event.child.name] = event.code
        if event.child is robot and event.code not in _WELL:
            break
        expected = (*_WELL, ExitCode.UNREACHABLE)
        patience_s = _PARTNER_S if event.code in expected else _CAUSE_S
        until = time.monotonic() + patience_s
    robot_ended_well = codes.get(robot.name) in _WELL
    for child in (robot, stabilizer):
        code = codes.get(child.name, ExitCode.OK)
        robot_explains_it = robot_ended_well and code == ExitCode.UNREACHABLE
        if code not in _WELL and not robot_explains_it:
            raise failure(child, code)
    for child in (robot, stabilizer):
        if child.name not in codes:
            raise ChildFailedError(
                f"{child.name}: did not end within {_PARTNER_S:g} s after the other "
                f"process{_words(child)}",
                exit_code=ExitCode.FAILED,
            )


def _left(until: float) -> float:
    return max(0.0, until - time.monotonic())


def failure(child: Child, code: int) -> ChildFailedError:
    """Turn a child's end into an error that quotes its last lines.

    A child that says what is wrong, as every command does, is quoted alone; the log
    before that is of interest only when it ended without a word.

    Args:
        child: whose end.
        code: its exit code; negative: the signal that ended it.
    """
    known = code in {int(entry) for entry in ExitCode}
    how = (
        f"was ended by signal {-code}" if code < 0 else f"failed with exit code {code}"
    )
    said = child.last_error() if known else ""
    return ChildFailedError(
        f"{child.name}: {how}{f': {said}' if said else _words(child)}",
        exit_code=ExitCode(code) if known else ExitCode.FAILED,
    )


def _words(child: Child) -> str:
    lines = child.last_lines()
    if not lines:
        return "; it said nothing"
    return "; its last lines:\n" + "\n".join(f"  {line}" for line in lines)
