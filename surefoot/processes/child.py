"""A process of a run: its log, its progress, and how it is stopped."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

from surefoot.errors import ERROR_PREFIX

LAST_LINES = 12
_TERMINATE_S = 5.0
"""Time for a process to end when asked, before it is killed [s]."""
READY_LINE = "ready"
_PROGRESS_PERIOD_S = 0.25


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
    """Tell the parent that this process can do its part now."""
    print(READY_LINE, flush=True)


class Progress(NamedTuple):
    """A child reached a tick."""

    tick: int


class Ready(NamedTuple):
    """A child that others wait for can do its part."""

    child: Child


class Exit(NamedTuple):
    """A child ended."""

    child: Child
    code: int
    """Exit code; negative: the signal that ended it."""


class Said(NamedTuple):
    """A child said where its page is."""

    child: Child
    url: str


Event = Progress | Ready | Exit | Said


class Child:
    """A ``surefoot`` command in a process of its own.

    It runs in its own process group, so Ctrl-C reaches only the parent, which then
    stops it in order. Its standard input is a pipe that nobody writes to: when the
    parent dies, however that happens, the pipe closes and the child ends itself.

    Attributes:
        name: for messages and the name of the log.
        log: everything it says on stderr.
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
            name: what it is.
            arguments: of the ``surefoot`` command, or of the module.
            log: file for its stderr.
            events: gets its progress, then its exit.
            module: what the process runs.
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
        """Whether the process is still there."""
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
        """Ask the process to end in order; once, since twice means at once."""
        if self.running and not self._is_asked:
            self._is_asked = True
            self._process.send_signal(signal.SIGTERM)

    def stop(self) -> None:
        """End the process, in order if it can, and wait until it is gone."""
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
        """Return the reason it gave for its end; empty without one."""
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
