"""The recorder as a third process of a run, which goes on without it."""

from __future__ import annotations

import time
from pathlib import Path
from queue import Empty, SimpleQueue

from cli.child import Child, Event, Exit, Ready
from cli.console import print_note
from cli.run_directory import MARKER
from cli.run_files import RECORD, SCENARIO, SETTINGS
from cli.run_plan import RunPlan

_READY_S = 20.0
"""The stabilizer waits so long for the recorder, on a busy machine [s]."""
_FINISH_S = 60.0
"""After the run the recorder may take so long to write what it holds [s]."""


def recorder_words(plan: RunPlan, folder: Path, endpoints: Path) -> list[str]:
    """Command line of the recorder.

    Args:
        plan: what is run.
        folder: of the run; its settings, scenario and description are attached.
        endpoints: file that says where the robot is.
    """
    profile = plan.servo_profile
    return [
        *("record", "--out", str(folder / RECORD), "--wait", str(_READY_S)),
        *("--robot", plan.robot_name),
        *(("--servo-profile", profile) if profile is not None else ()),
        *(
            word
            for name in (MARKER, SETTINGS, SCENARIO)
            for word in ("--attach", str(folder / name))
        ),
        *("--endpoints", str(endpoints)),
    ]


def await_recorder(recorder: Child, *, events: SimpleQueue[Event]) -> None:
    """Waits until the recorder receives everything, or cannot be waited for.

    Args:
        recorder: just started.
        events: of all children; those of others are kept for later.
    """
    others: list[Event] = []
    end = time.monotonic() + _READY_S
    while True:
        try:
            event = events.get(timeout=max(0.0, end - time.monotonic()))
        except Empty:
            print_note(
                f"recorder: not ready within {_READY_S:g} s; the run begins without "
                "it, and the start may be missing from the record"
            )
            break
        if isinstance(event, Ready):
            break
        if not isinstance(event, Exit) or event.child is not recorder:
            others.append(event)
        # Of a recorder that has ended the user is told at the end of the run.
        if isinstance(event, Exit):
            break
    for event in others:
        events.put(event)


def see_recorder_off(recorder: Child) -> None:
    """Waits until the record is complete; says so if it is not."""
    code = recorder.wait(_FINISH_S)
    if code is None:
        print_note(f"recorder: did not end within {_FINISH_S:g} s after the run")
        return
    # The folder takes another name at the end of the run.
    here = f"{recorder.log.parent}/"
    lines = [line.replace(here, "") for line in recorder.last_lines()]
    if code == 0:
        for line in lines:
            if " WARNING " in line:
                print_note(f"recorder: {line}")
        return
    how = (
        f"was ended by signal {-code}" if code < 0 else f"failed with exit code {code}"
    )
    words = "".join(f"\n  {line}" for line in lines[-3:])
    print_note(f"recorder: {how}; the run went on, its record is cut off{words}")
