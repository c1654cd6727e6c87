"""Records a live robot's bus until the robot leaves or somebody asks to stop."""

from __future__ import annotations

import time
from collections.abc import Callable

from cli.recording.mcap_file import McapFile
from robot_io.observer import Observer
from robot_io.stop_request import StopRequest

RING_DEPTH = 16384
"""Messages kept per channel while we write: five seconds at 3000 ticks a second."""
PERIOD_S = 0.02
"""Many messages at a time cost the other processes less than each for itself."""
LAST_S = 0.3
"""Once the robot is gone, what is still on its way may take so long [s]."""


def record_bus(
    observer: Observer,
    file: McapFile,
    *,
    on_ready: Callable[[], None],
    stop: StopRequest,
) -> None:
    """Writes everything that comes.

    Args:
        observer: connected, ``status`` the last of its channels.
        file: gets the messages.
        on_ready: called at the first ``status``: whoever receives it receives all.
        stop: ends the recording in order.

    Raises:
        OSError: the file cannot be written.
    """
    is_ready = False
    with stop.on_signals():
        while observer.robot_is_here and not stop.is_set:
            samples = observer.take()
            file.add(samples)
            if not is_ready and file.counts["status"].messages:
                is_ready = True
                on_ready()
            time.sleep(PERIOD_S)  # gathers: waking per message would cost the loop
        while samples := observer.take(timeout_s=LAST_S):
            file.add(samples)
            if stop.is_set and observer.robot_is_here:
                break
