"""The live page as one more process of a run."""

from __future__ import annotations

import time
from pathlib import Path
from queue import Empty, SimpleQueue

from cli.child import Child, Event, Exit, Said
from cli.console import print_note
from cli.errors import ChildFailedError
from cli.exit_codes import ExitCode
from cli.run_plan import RunPlan
from cli.supervise import failure

READY_S = 30.0
"""How long the page may take to come up, on a busy machine [s]."""


def start_live_page(
    plan: RunPlan,
    folder: Path,
    *,
    endpoints: Path,
    port: int,
    events: SimpleQueue[Event],
) -> Child:
    """Starts the page and waits until it is served, so that it misses nothing.

    Args:
        plan: names the robot.
        folder: gets its log.
        endpoints: file that says where it dials.
        port: of the page.
        events: of the run; nobody else has been started yet.

    Returns:
        The process; the run goes on whatever becomes of it.

    Raises:
        ChildFailedError: the page could not be served.
    """
    words = ["view", "--robot", plan.robot_name, "--port", str(port)]
    words += ["--endpoints", str(endpoints)]
    child = Child("view", words, log=folder / "view.log", events=events)
    deadline = time.monotonic() + READY_S
    try:
        while True:
            event = events.get(timeout=max(0.0, deadline - time.monotonic()))
            if isinstance(event, Exit):
                raise failure(child, event.code)
            if isinstance(event, Said):
                print_note(f"live page: {event.url}")
                return child
    except Empty:
        child.stop()
        raise ChildFailedError(
            f"view: the page was not there within {READY_S:g} s",
            exit_code=ExitCode.FAILED,
        ) from None
    except BaseException:
        child.stop()
        raise
