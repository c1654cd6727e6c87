"""A run as two processes that meet on the bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

from cli.child import Child, Event
from cli.endpoints import private_endpoints
from cli.endpoints_file import ENDPOINTS, write_endpoints
from cli.exit_codes import ExitCode
from cli.live_page import start_live_page
from cli.run_files import SETTINGS, TICKS, read_struct
from cli.run_plan import RunPlan
from cli.run_recorder import await_recorder, recorder_words, see_recorder_off
from cli.supervise import failure, supervise
from schemas.endpoints import Endpoints
from schemas.result import ControllerResult, PlantResult, RelayResult

_START_S = 60.0
"""A robot that is still there may take so long to come up, on a busy machine [s]."""


class Sides(NamedTuple):
    """What the two sides of a run measured."""

    plant: PlantResult
    controller: ControllerResult
    relay: RelayResult | None = None


def run_processes(
    plan: RunPlan,
    folder: Path,
    *,
    endpoints: Endpoints,
    record: bool,
    on_tick: Callable[[int], None],
    view_port: int | None = None,
    histogram: bool = False,
    priority: int | None = None,
) -> Sides:
    """Starts robot, recorder and stabilizer, waits for the end, stops all.

    Neither waits a fixed time for the other: the stabilizer dials until the robot's
    liveliness token is there, and the robot's clock starts with its commander.

    Args:
        plan: what to run.
        folder: holds the settings file; gets logs and the record.
        endpoints: where the two meet.
        record: write every tick, and the bus by a recorder of its own. What happens to
            the recorder is told, and never ends the run.
        on_tick: told the robot's progress.
        view_port: serve a live page of the run at this port; None for no page.
        histogram: whether the results hold those of all times.
        priority: of SCHED_FIFO for the two; None for ordinary processes.

    Raises:
        ChildFailedError: one of the two failed, or the relay between them.
    """
    plant_file, controller_file = folder / "plant.json", folder / "controller.json"
    relay_file = folder / "relay.json"
    beyond = endpoints if plan.relay_path is None else private_endpoints()
    meeting, beyond_file = folder / ENDPOINTS, folder / f"beyond-{ENDPOINTS}"
    write_endpoints(meeting, endpoints)
    write_endpoints(beyond_file, beyond)
    shared = _shared_words(plan)
    if histogram:
        shared.append("--histogram")
    if priority is not None:
        shared += ["--realtime-priority", str(priority)]
    robot_words = [
        *_robot_words(plan),
        *shared,
        *("--endpoints", str(meeting)),
        *("--result-file", str(plant_file)),
    ]
    if record:
        robot_words += ["--record-file", str(folder / TICKS)]
    stabilizer_words = [
        *_stabilizer_words(plan),
        *shared,
        *("--endpoints", str(beyond_file)),
        *("--settings", str(folder / SETTINGS)),
        *("--result-file", str(controller_file)),
    ]
    events: SimpleQueue[Event] = SimpleQueue()
    children: list[Child] = []

    def start(name: str, words: list[str]) -> Child:
        child = Child(name, words, log=folder / f"{name}.log", events=events)
        children.append(child)
        return child

    try:
        if view_port is not None:
            children += [
                start_live_page(
                    plan, folder, endpoints=meeting, port=view_port, events=events
                )
            ]
        robot = start("robot", robot_words)
        recorder = None
        if record:
            recorder = start("recorder", recorder_words(plan, folder, meeting))
            await_recorder(recorder, events=events)
        relay = None
        if plan.relay_path is not None:
            words = _relay_words(plan, plan.relay_path, endpoints, beyond)
            relay = start("relay", [*words, "--result-file", str(relay_file)])
        stabilizer = start("stabilizer", stabilizer_words)
        supervise(robot, stabilizer, events=events, on_tick=on_tick, between=relay)
        if recorder is not None:
            see_recorder_off(recorder)
    finally:
        for child in children:
            child.ask_to_end()
        for child in children:
            child.stop()
    sides = Sides(
        plant=read_struct(plant_file, PlantResult),
        controller=read_struct(controller_file, ControllerResult),
        relay=None if relay is None else _relay_result(relay, relay_file),
    )
    relay_file.unlink(missing_ok=True)
    for file in (plant_file, controller_file, meeting, beyond_file):
        file.unlink()
    return sides


def _relay_result(relay: Child, file: Path) -> RelayResult:
    """What a relay counted, once it has ended.

    Raises:
        ChildFailedError: it ended without a word of it.
    """
    if not file.is_file():
        raise failure(relay, relay.wait(0.0) or ExitCode.FAILED)
    return read_struct(file, RelayResult)


def _robot_words(plan: RunPlan) -> list[str]:
    return ["robot", str(plan.scenario_path), "--seed", str(plan.seed)]


def _stabilizer_words(plan: RunPlan) -> list[str]:
    return ["stabilizer", "--controller", plan.controller, "--wait", str(_START_S)]


def _relay_words(
    plan: RunPlan, relay_path: Path, robots: Endpoints, beyond: Endpoints
) -> list[str]:
    """Command line of the relay, which dials the robot and listens beyond."""
    return [
        *("relay", str(relay_path), "--robot", plan.robot_name),
        *("--seed", str(plan.seed), "--wait", str(_START_S)),
        *(word for locator in robots.connect for word in ("--connect", locator)),
        *(word for locator in beyond.listen for word in ("--listen", locator)),
    ]


def _shared_words(plan: RunPlan) -> list[str]:
    profile = plan.servo_profile
    return [
        *("--robot", plan.robot_name, f"--{plan.mode}"),
        *(("--servo-profile", profile) if profile is not None else ()),
    ]
