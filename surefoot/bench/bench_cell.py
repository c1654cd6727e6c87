"""One run of a benchmark: a scenario built for it, and what is looked at meanwhile."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from surefoot.run_plan import RunPlan
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.sensing import Sensors
from surefoot.simulation import Simulation
from surefoot.studies.cell import Row, figures_of, plan_in

NOISE = Sensors(
    force_noise_n=2.0,
    moment_noise_nm=0.1,
    gyro_noise_rad_s=0.002,
    accel_noise_m_s2=0.05,
)
"""Of the shipped scenarios, for a benchmark's too."""


class Under(NamedTuple):
    """Who is measured."""

    variant: str
    servo_profile: str

    @property
    def label(self) -> str:
        """As in tables and plots."""
        return f"{self.variant}, {self.servo_profile}"


class Probe(Protocol):
    """Looks at a run while it goes."""

    def look(self, sim: Simulation) -> None:
        """Take in the present tick."""

    def figures(self) -> dict[str, Any]:
        """What it saw, as built-in types."""


@dataclass(frozen=True, kw_only=True)
class BenchCell(ABC):
    """A run of a benchmark.

    Attributes:
        case: what is done to the robot; unique among the cases of a study.
        scenario: the same as a scenario.
        under: controller and servo profile.
        seed: of the sensor noise.
    """

    case: str
    scenario: Scenario
    under: Under
    seed: int = 0

    @property
    def group(self) -> tuple[str, Under]:
        """The same for runs that differ by their seed only."""
        return self.case, self.under

    @property
    def key(self) -> str:
        """Unique in a study, and readable."""
        return "|".join((self.case, *self.under, str(self.seed)))

    @abstractmethod
    def probe(self) -> Probe:
        """A fresh probe for a run."""

    def plan(self, *, robot: str, overrides: tuple[str, ...]) -> RunPlan:
        """Return the run's plan."""
        return plan_in(
            self.scenario,
            None,
            variant=self.under.variant,
            servo_profile=self.under.servo_profile,
            seed=self.seed,
            robot=robot,
            overrides=overrides,
        )

    def run(self, plan: RunPlan) -> Row:
        """Run its plan; what was run, the figures, and what the probe saw."""
        from surefoot.stabilizer.factory import make_controller

        sim = Simulation.of_plan(plan)
        probe = self.probe()
        controller = make_controller(plan.controller, plan.robot, plan.settings)
        sim.run(controller, on_tick=lambda tick: probe.look(sim))
        return {
            "case": self.case,
            "variant": self.under.variant,
            "servo_profile": self.under.servo_profile,
            "seed": self.seed,
            **figures_of(sim.result()),
            "seen": probe.figures(),
        }
