"""How old readings are: what the loop has to bear beside its own delay.

Ages count from the newest reading of the same snapshot, by the stamps of measuring: a
delay that all sensors share cannot be seen from here, and is a part of
``dik.loop_delay_s``.
"""

from __future__ import annotations

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.messages import ForceTorque
from surefoot.schemas.sensors import SENSORS

WINDOW_S = 0.1
"""Ages are gathered over so long: longer than from one reading of a slow sensor to
its next [s]."""
FORGOTTEN_WINDOWS = 10
"""So long a larger age counts on."""
NS_PER_S = 1e9

FORCES = tuple(
    index for index, entry in enumerate(SENSORS) if entry.message is ForceTorque
)
MOTION = tuple(index for index in range(len(SENSORS)) if index not in FORCES)


class ReadingAges:
    """Largest age of force readings and mean age of the others, lately.

    Attributes:
        forces_s: largest age of any force reading in the last second [s].
        motion_s: mean age of the oldest of the other readings [s].
    """

    def __init__(self, *, period_s: float) -> None:
        """Begin with readings of the present.

        Args:
            period_s: from tick to tick [s].
        """
        self._ticks = max(1, round(WINDOW_S / period_s))
        self._largest = [0.0] * FORGOTTEN_WINDOWS
        self._count, self._sum = 0, 0.0
        self.forces_s = 0.0
        self.motion_s = 0.0

    def add(self, snapshot: Snapshot) -> bool:
        """Note the ages of a tick's readings.

        Returns:
            Whether what is known of them has changed.
        """
        measured = snapshot.measured_ns
        newest = max(measured)
        forces_s = (newest - min([measured[index] for index in FORCES])) / NS_PER_S
        motion_s = (newest - min([measured[index] for index in MOTION])) / NS_PER_S
        self._sum += motion_s
        self._count += 1
        self._largest[-1] = max(self._largest[-1], forces_s)
        is_older = forces_s > self.forces_s
        if is_older:
            self.forces_s = forces_s
        if self._count < self._ticks:
            return is_older
        self.forces_s = max(self._largest)
        self.motion_s = self._sum / self._count
        self._largest = [*self._largest[1:], 0.0]
        self._count, self._sum = 0, 0.0
        return True
