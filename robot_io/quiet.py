"""Keeps the interpreter from getting in the way of a control loop."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

SWITCH_INTERVAL_S = 1e-4
"""How long another thread waits for the interpreter at most; 5 ms by default."""


@contextmanager
def quiet_interpreter() -> Iterator[None]:
    """No garbage collection, and short turns for other threads, while inside.

    Numbers that overflow make no warning either: a loop looks at its numbers itself.

    What the loop allocates must be free of cycles, as it is not collected until the
    end.
    """
    switch_interval_s = sys.getswitchinterval()
    was_enabled = gc.isenabled()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            yield
    finally:
        sys.setswitchinterval(switch_interval_s)
        gc.unfreeze()
        if was_enabled:
            gc.enable()
