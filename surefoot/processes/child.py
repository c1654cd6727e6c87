"""Child processes: starts, watches and ends them, and reads their progress.

A process also uses it to log and to report its progress to its parent.
"""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import NamedTuple

from surefoot.errors import ERROR_PREFIX, ChildFailedError, ExitCode

_LOG = logging.getLogger("surefoot")
LAST_LINES = 12
_TERMINATE_S = 5.0
"""Time for a process to end when asked, before it is killed [s]."""
READY_LINE = "ready"
_PROGRESS_PERIOD_S = 0.25
_PARTNER_S = 10.0
"""Time for the second process to end after the first has ended well [s]."""
_CAUSE_S = 2.0
"""Time after the stabilizer's failure in which the robot's own still counts [s]."""


def begin_process(name: str, *, child: bool = False) -> None:
    """Send this program's notes, warnings and errors to stderr."""
    logging.basicConfig(
        level=logging.INFO,
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
        datefmt="%H:%M:%S",
    )
    log_note(f"{name}, process {os.getpid()}")
    if child:
        begin_as_child()


def log_note(text: str) -> None:
    """Log a note."""
    _LOG.info(text)


def log_warning(text: str) -> None:
    """Log a warning that the user should not miss."""
    _LOG.warning(text)


def begin_as_child() -> None:
    """End this process in order (SIGTERM to itself) once its stdin closes."""

    def watch() -> None:
        while os.read(sys.stdin.fileno(), 4096):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()


def progress_reporter() -> Callable[[int], None]:
    """Make a function that writes the tick to stdout, four times a second at most."""
    due = 0.0

    def report(tick: int) -> None:
        nonlocal due
        now = time.monotonic()
        if now >= due:
            due = now + _PROGRESS_PERIOD_S
            print(tick, flush=True)

    return report


def report_ready() -> None:
    """Tell the parent that this process is ready."""
    print(READY_LINE, flush=True)


class Progress(NamedTuple):
    """A child reached a tick."""

    tick: int


class Ready(NamedTuple):
    """A child that others wait for is ready."""

    child: Child


class Exit(NamedTuple):
    """A child ended."""

    child: Child
    code: int
    """Exit code; if negative, the number of the signal that ended it."""


class Said(NamedTuple):
    """A child reported the address of its page."""

    child: Child
    url: str


Event = Progress | Ready | Exit | Said


class Child:
    """A ``surefoot`` command in a process of its own.

    It runs in its own process group: Ctrl-C reaches only the parent, which then stops
    the child in order. Its standard input is a pipe to which nobody writes. When the
    parent dies for any reason, the pipe closes and the child ends itself.

    Attributes:
        name: for messages and the name of the log.
        log: file of its stderr.
    """

    def __init__(
        self,
        name: str,
        arguments: list[str],
        *,
        log: Path,
        events: SimpleQueue[Event],
        module: str = "surefoot.cli",
    ) -> None:
        """Start the process.

        Args:
            name: name of the child.
            arguments: of the ``surefoot`` command, or of the module.
            log: file for its stderr.
            events: gets its progress, then its exit.
            module: Python module that the process runs.
        """
        self.name, self.log = name, log
        self._is_asked = False
        with log.open("wb") as stderr:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, *arguments, "--child"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=stderr,
                env=child_environment(),
                process_group=0,  # no session: Linux shares processors between those
            )
        self._watch = threading.Thread(
            target=self._report, args=(events,), name=f"watch-{name}", daemon=True
        )
        self._watch.start()

    @property
    def running(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def wait(self, timeout_s: float) -> int | None:
        """Wait for the process to end by itself.

        Returns:
            Its exit code; None when it has not ended in time.
        """
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def ask_to_end(self) -> None:
        """Ask the process to end in order; only once, since twice means at once."""
        if self.running and not self._is_asked:
            self._is_asked = True
            self._process.send_signal(signal.SIGTERM)

    def stop(self) -> None:
        """End the process, in order if possible, and wait until it is gone."""
        self.ask_to_end()
        try:
            self._process.wait(_TERMINATE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._watch.join()

    def last_lines(self) -> list[str]:
        """Return the end of its log, blank lines left out."""
        with self.log.open(encoding="utf-8", errors="replace") as file:
            lines = (line.rstrip() for line in file)
            return list(deque(filter(None, lines), maxlen=LAST_LINES))

    def last_error(self) -> str:
        """Return the reason that the process gave for its end; empty without one."""
        text = self.log.read_text(encoding="utf-8", errors="replace")
        *_, last = f"\n{text}".rpartition(f"\n{ERROR_PREFIX} ")
        return last.strip() if last != f"\n{text}" else ""

    def _report(self, events: SimpleQueue[Event]) -> None:
        stdout = self._process.stdout
        if stdout is not None:
            with stdout:
                for line in stdout:
                    if line.strip().isdigit():
                        events.put(Progress(int(line)))
                    elif line.startswith(b"http"):
                        events.put(Said(self, line.decode().strip()))
                    elif line.strip() == READY_LINE.encode():
                        events.put(Ready(self))
        events.put(Exit(self, self._process.wait()))


def child_environment() -> dict[str, str]:
    """Return the environment with which the child runs this code from any folder."""
    root = str(Path(__file__).resolve().parents[2])
    inherited = os.environ.get("PYTHONPATH", "")
    path = os.pathsep.join(filter(None, [root, inherited]))
    return {**os.environ, "PYTHONPATH": path}


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
        robot: the robot's process, which ends the run.
        stabilizer: the stabilizer's process.
        events: of both.
        on_tick: called with the robot's tick.
        between: a relay, without which the two cannot go on.

    Raises:
        ChildFailedError: one failed, or did not end after the other; the message
            quotes its last lines. The robot's failure is named before the
            stabilizer's, which may follow from it; a relay's before both.
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
                until = time.monotonic() + _PARTNER_S  # the robot holds and goes on
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

    If the child gave a reason, as every command does, only that is quoted. Otherwise
    the end of its log is quoted.
    """
    known = code in {int(entry) for entry in ExitCode}
    said = child.last_error() if known else ""
    return ChildFailedError(
        f"{child.name}: {how_ended(code)}{f': {said}' if said else _words(child)}",
        exit_code=ExitCode(code) if known else ExitCode.FAILED,
    )


def how_ended(code: int) -> str:
    """Return in words how a process with this exit code ended."""
    if code < 0:
        return f"was ended by signal {-code}"
    return f"failed with exit code {code}"


def _words(child: Child) -> str:
    lines = child.last_lines()
    if not lines:
        return "; it said nothing"
    return "; its last lines:\n" + "\n".join(f"  {line}" for line in lines)
