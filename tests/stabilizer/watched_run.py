"""The real controller, watched or not, on the simulated robot in one process."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Delivery
from surefoot.schemas.result import Distribution, PlantResult
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings, SafetySettings
from surefoot.sim_robot.simulated_robot import SimulatedRobot
from surefoot.stabilizer.control.controller import Controller
from surefoot.stabilizer.control.whole_body import WholeBodyController
from surefoot.stabilizer.safety.safety import Safety, SafetyState
from tests.stabilizer.closed_loop import DELAY, NOISE


@dataclass(frozen=True)
class WatchedRun:
    """How a run went.

    Attributes:
        log_sha256: fingerprint of all readings and commands.
        fell: whether the robot did.
        com_error_max_mm: (3,) largest error of the centre of mass [mm].
        states: what the safety layer went through, each stay once.
        reason: its last word.
        reasons: all it gave, each once, in order.
    """

    log_sha256: str
    fell: bool
    com_error_max_mm: tuple[float, float, float] | None
    states: list[SafetyState]
    reason: str
    reasons: list[str]


def watched_run(
    robot: Robot,
    *,
    is_watched: bool = True,
    seed: int = 0,
    safety_settings: SafetySettings | None = None,
    **scenario: Any,
) -> WatchedRun:
    """Run a scenario; other keywords are its keys, noise and delay as shipped."""
    table = {"name": "test", "sensors": NOISE, "delay": DELAY, **scenario}
    simulated = SimulatedRobot(
        robot, scenario_from_table(table, source="test"), seed=seed
    )
    settings = ControllerSettings()
    controller: Controller = WholeBodyController(robot, settings)
    safety = Safety(controller, robot, safety_settings or settings.safety)
    safety.start(simulated.sense(), simulated.held_posture)
    delivery, commands = Delivery(), {}
    states, reasons = [safety.state], [safety.reason]
    while not simulated.finished:
        tick = simulated.tick
        snapshot, ages = delivery.deliver(simulated.sense(), simulated.unread_sensors)
        if not is_watched:
            commands[tick] = controller.step(snapshot).q_command.copy()
        elif not safety.is_done:
            commands[tick] = safety.step(snapshot, ages).q_command.copy()
        if safety.state is not states[-1]:
            states.append(safety.state)
        if safety.reason != reasons[-1]:
            reasons.append(safety.reason)
        due = simulated.commands_needed(tick)
        if due in commands:
            simulated.apply(commands.pop(due), tick=due)
        simulated.step()
    result = _result(simulated)
    return WatchedRun(
        log_sha256=result.log_sha256,
        fell=simulated.fell,
        com_error_max_mm=result.com_error_max_mm,
        states=states,
        reason=safety.reason,
        reasons=reasons,
    )


def _result(simulated: SimulatedRobot) -> PlantResult:
    nothing = Distribution(median=0.0, p99=0.0, max=0.0)
    return simulated.result(
        real_time_factor=0.0,
        round_trip_ms=nothing,
        period_jitter_ms=nothing,
        deadline_misses=0,
        refused={},
        clipped={},
    )
