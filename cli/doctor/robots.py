"""What the shipped robots bear with the default settings."""

from __future__ import annotations

from collections.abc import Iterator

from surefoot.cli.doctor.examine import Diagnosis, Severity, finding
from surefoot.loop_margins import compute_margins
from surefoot.robot_io.robot import list_robots, load_robot


def check_margins() -> Iterator[Diagnosis]:
    """Check the margins of every shipped robot with every servo profile."""
    for name in list_robots():
        for profile in load_robot(name).file.servo.profiles:
            found = compute_margins(name, servo_profile=profile)
            yield finding(
                f"margins of {name}, {profile}",
                "; ".join(found.in_words()),
                bad=None if found.is_enough else Severity.WARN,
                advice="as it was made, and no fault of this machine; surefoot "
                "margins tells more",
            )
