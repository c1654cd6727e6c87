"""Makes the files of ground that shipped scenarios play.

``python -m benchmarks.ground_files`` writes them into the package. They are the same
every time; a test compares them.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.sim_robot.catalogue import SCENARIOS_DIR
from surefoot.sim_robot.recorded import (
    passenger_pulse,
    strong_motion,
    write_ground,
)

PULSES = {
    "start": passenger_pulse(1.5, jerk_m_s3=5.6),
    "start_hard": passenger_pulse(3.0, jerk_m_s3=11.3),
    "brake": passenger_pulse(-1.0, jerk_m_s3=5.6),
    "brake_hard": passenger_pulse(-2.5, jerk_m_s3=11.3),
}
SHAKES = {
    "ahead": strong_motion(peak_m_s2=3.0, seed=1),
    "sideways": strong_motion(peak_m_s2=2.5, seed=2),
    "up": strong_motion(peak_m_s2=1.5, ground_hz=5.0, seed=3),
}


def write_all(folder: Path) -> None:
    """Write all files into a folder."""
    longest = max((times for times, _ in PULSES.values()), key=len)
    write_ground(
        folder / "passenger-pulses.csv",
        longest,
        {name: velocity for name, (_, velocity) in PULSES.items()},
    )
    write_ground(
        folder / "strong-motion.csv",
        SHAKES["ahead"][0],
        {name: acceleration for name, (_, acceleration) in SHAKES.items()},
    )


if __name__ == "__main__":
    write_all(SCENARIOS_DIR)
