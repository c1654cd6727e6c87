"""The controller under the safety layer, on the simulated robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from surefoot.robot_io.robot import Robot
from surefoot.schemas.reasons import EndReason, SensorTrouble, StabilizerState
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings, SafetySettings
from surefoot.simulation import Simulation
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import DELAY, NOISE


@dataclass(frozen=True)
class WatchedRun:
    """The results of a run under the safety layer.

    Attributes:
        log_sha256: digest of all readings and commands.
        fell: whether the robot fell.
        com_error_max_mm: (3,) largest error of the CoM [mm].
        states: successive states of the safety layer.
        end: reason for its end.
        detail: its last detail.
        details: the different details, in order.
        losses: lost sensors.
    """

    log_sha256: str
    fell: bool
    com_error_max_mm: tuple[float, float, float] | None
    states: list[StabilizerState]
    end: EndReason
    detail: str
    details: list[str]
    losses: dict[str, SensorTrouble]


def watched_run(
    robot: Robot,
    *,
    seed: int = 0,
    safety_settings: SafetySettings | None = None,
    **scenario: Any,
) -> WatchedRun:
    """Run a scenario; other keywords are its keys; noise and delay as shipped."""
    table = {"name": "test", "sensors": NOISE, "delay": DELAY, **scenario}
    settings = ControllerSettings(safety=safety_settings or SafetySettings())
    sim = Simulation(
        robot,
        scenario_from_table(table, source="test"),
        seed=seed,
        settings=settings,
    )
    controller = WholeBodyController(robot, settings)
    states, details = [StabilizerState.ACTIVE], [""]
    while not sim.finished:
        sim.step(controller)
        safety = sim.safety
        assert safety is not None
        if safety.state is not states[-1]:
            states.append(safety.state)
        if safety.detail != details[-1]:
            details.append(safety.detail)
    result = sim.result()
    return WatchedRun(
        log_sha256=result.log_sha256,
        fell=sim.fell,
        com_error_max_mm=result.com_error_max_mm,
        states=states,
        end=safety.end,
        detail=safety.detail,
        details=details,
        losses=safety.losses,
    )
