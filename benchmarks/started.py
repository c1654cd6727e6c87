"""``surefoot`` commands as processes of benchmarks, and shortened scenarios."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Self, TypeVar

from surefoot.sim_robot.catalogue import find_scenario

T = TypeVar("T")
DEADLINE_S = 120.0
PAUSE_S = 0.001


def shortened(name: str, duration_s: float) -> str:
    """Return the text of a shipped scenario with another duration [s]."""
    text = find_scenario(name).read_text(encoding="utf-8")
    whole = f"duration_s = {duration_s}"  # the first one: those of pushes come later
    return re.sub(r"(?m)^duration_s = .*$", whole, text, count=1)


def wait_until(condition: Callable[[], T], *, what: str) -> T:
    """Call a condition again and again until its answer is truthy; return the answer.

    Raises:
        TimeoutError: no answer was truthy in time.
    """
    end = time.monotonic() + DEADLINE_S
    while not (answer := condition()):
        if time.monotonic() > end:
            raise TimeoutError(f"waited {DEADLINE_S:g} s for {what}")
        time.sleep(PAUSE_S)  # another process has no event to wait for
    return answer


def run_json(*words: object, ended: Collection[int] = (0,)) -> dict[str, Any]:
    """Return the result object of ``surefoot run``.

    Raises:
        RuntimeError: the run gave no result; the message quotes its last lines.
    """
    told = ["run", *map(str, words), "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "surefoot.cli", *told],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in ended or not done.stdout:
        raise RuntimeError(
            f"surefoot {' '.join(told)}: exit {done.returncode}\n{done.stderr[-800:]}"
        )
    result: dict[str, Any] = json.loads(done.stdout)
    return result


class Started:
    """A ``surefoot`` command; a context manager that leaves no process behind."""

    def __init__(self, log: Path, *words: object) -> None:
        """Start it; its output goes to a log."""
        self._log = log
        with log.open("w") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "surefoot.cli", *map(str, words)],
                stdout=file,
                stderr=subprocess.STDOUT,
            )

    def __enter__(self) -> Self:
        """Return itself; the process already runs."""
        return self

    def __exit__(self, *why: object) -> None:
        """Kill the process if it still runs."""
        self.process.kill()
        self.process.wait()

    def signal(self, number: int) -> None:
        """Send a signal."""
        self.process.send_signal(number)

    def exit_code(self) -> int:
        """Wait for its end; return its exit code."""
        return self.process.wait(DEADLINE_S)

    def said(self) -> str:
        """Return its output so far."""
        return self._log.read_text(errors="replace")

    def wait_for(self, words: str) -> None:
        """Wait until its output holds some words.

        Raises:
            TimeoutError: they did not come in time.
        """
        wait_until(lambda: words in self.said(), what=f"{words!r} in {self._log}")
