"""A worker process of a study lives as long as its parent does."""

from __future__ import annotations

import os
import threading
import time

LOOK_S = 0.5


def end_with(parent: int) -> None:
    """Ends this process once its parent was killed, whatever it does then.

    Nobody would get what it does; and a parent that dies while it holds a lock of its
    workers would leave those that wait for work waiting forever.

    Args:
        parent: id of the process that asks for the work.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_S)  # nothing tells a process that its parent has died
        os._exit(1)

    threading.Thread(target=watch, name="parent-watch", daemon=True).start()
