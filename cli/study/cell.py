"""One run of a study, and how it is told from all others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple


class Group(NamedTuple):
    """Runs that differ by their seed only."""

    scenario: str
    values: tuple[tuple[str, Any], ...]
    variant: str
    servo_profile: str

    @property
    def case(self) -> str:
        """Scenario and what was varied, in words."""
        words = ", ".join(f"{name} {value:g}" for name, value in self.values)
        return f"{self.scenario} ({words})" if words else self.scenario


@dataclass(frozen=True)
class Cell:
    """What is run, and with which seed.

    Attributes:
        group: scenario, its varied values, controller and servo profile.
        seed: of the sensor noise.
    """

    group: Group
    seed: int

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        group = self.group
        values = ",".join(f"{name}={value!r}" for name, value in group.values)
        parts = (group.scenario, values, group.variant, group.servo_profile)
        return "|".join((*parts, str(self.seed)))
