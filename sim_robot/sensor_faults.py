"""Makes sensors fail as a scenario asks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.scenario import SensorFault
from surefoot.schemas.sensors import Sensor, sensor

IMPOSSIBLE = 1e6
"""More than any sensor can measure, in any unit."""


class SensorFaults:
    """Changes readings while faults act; without faults it hands them through.

    Attributes:
        missing: sensors with no message for the last tick.
        unread: these, and those whose message is refused as it holds no numbers.
    """

    def __init__(self, faults: Sequence[SensorFault], *, period_s: float) -> None:
        """Read the faults of a scenario.

        Args:
            faults: in the order of the file; later ones act on what earlier ones left.
            period_s: from tick to tick [s].
        """
        self.missing: tuple[str, ...] = ()
        self.unread: tuple[str, ...] = ()
        self._faults = [
            (
                fault,
                math.ceil(fault.start_s / period_s - 1e-9),
                math.ceil((fault.start_s + fault.duration_s) / period_s - 1e-9),
            )
            for fault in faults
        ]
        self._frozen: dict[int, dict[str, Array]] = {}
        self._last: Snapshot | None = None

    def apply(self, snapshot: Snapshot) -> Snapshot:
        """Return the readings with faults applied; called once per tick, in order."""
        if not self._faults:
            return snapshot
        missing: list[str] = []
        unreadable: list[str] = []
        reported = snapshot
        for index, (fault, begin, end) in enumerate(self._faults):
            if not begin <= snapshot.tick < end:
                continue
            if fault.kind == "drop":
                missing.append(fault.sensor)
            elif fault.kind == "freeze":
                reported = replace(reported, **self._freeze(index, fault, reported))
            else:
                reported = replace(reported, **_spoil(fault, reported))
            if fault.kind == "nan":
                unreadable.append(fault.sensor)
        self._last = reported
        self.missing = tuple(missing)
        self.unread = (*missing, *unreadable)
        return reported

    def _freeze(
        self, index: int, fault: SensorFault, present: Snapshot
    ) -> dict[str, Any]:
        if index not in self._frozen:
            source = self._last if self._last is not None else present
            self._frozen[index] = {
                name: getattr(source, name) for name in sensor(fault.sensor).fields
            }
        return self._frozen[index]


def _spoil(fault: SensorFault, snapshot: Snapshot) -> dict[str, Any]:
    failing = sensor(fault.sensor)
    if fault.kind == "jump":
        return _shifted(failing, snapshot, by=fault.offset)
    wrong = math.nan if fault.kind == "nan" else IMPOSSIBLE
    return {
        name: np.full_like(getattr(snapshot, name), wrong) for name in failing.fields
    }


def _shifted(failing: Sensor, snapshot: Snapshot, *, by: float) -> dict[str, Any]:
    """The reading a jump touches, with an offset."""
    field, part = failing.place(failing.offset.attribute)
    values = getattr(snapshot, field).copy()
    axis = failing.offset.axis
    values[part][slice(None) if axis is None else axis] += by
    return {field: values}
