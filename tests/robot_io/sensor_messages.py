"""Sensor messages whose values show their tick."""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout, sensor_messages
from surefoot.schemas.messages import Message
from surefoot.schemas.topics import TICK_SENSORS

JOINTS = 28
LAYOUT = SnapshotLayout(JOINTS)


def snapshot_at(tick: int) -> Snapshot:
    """Return the sensors at a tick; every number differs from those of other ticks."""
    numbers = np.random.default_rng(tick).normal(size=LAYOUT.size)
    return LAYOUT.view(tick, 1000 + tick, numbers)


def message(name: str, tick: int) -> Message:
    """Return the message of one channel at a tick."""
    messages = sensor_messages(snapshot_at(tick), stamp_ns=1000 + tick)
    return messages[TICK_SENSORS.index(name)]
