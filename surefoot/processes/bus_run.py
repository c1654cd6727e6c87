"""A run as two processes that meet on the bus: starts, watches and ends them.

``surefoot.runs`` uses it; recorder, relay and live page are further processes.
"""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import NamedTuple

from msgspec.structs import replace

from surefoot.errors import ChildFailedError, ExitCode
from surefoot.outcome import Sides
from surefoot.processes.child import (
    Child,
    Event,
    Exit,
    Ready,
    Said,
    failure,
    how_ended,
    supervise,
)
from surefoot.robot_io.bus.bus import loopback_endpoints
from surefoot.run_folder import (
    CONTROLLER_TICKS,
    MARKER,
    RECORD,
    SCENARIO,
    SETTINGS,
    TICKS,
    read_struct,
)
from surefoot.run_plan import RunPlan
from surefoot.schemas.endpoints import Endpoints, write_endpoints
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.result import ControllerResult, PlantResult, RelayResult

_LOG = logging.getLogger("surefoot.run")
ENDPOINTS = "endpoints.toml"

_START_S = 60.0
"""Longest wait for robot, recorder or page to start on a busy machine [s]."""
_FINISH_S = 60.0
"""Longest time for the recorder to finish its file after the run [s]."""


def recorder_argv(plan: RunPlan, folder: Path, endpoints: Path) -> list[str]:
    """Command line of the recorder."""
    return [
        *("record", "--out", str(folder / RECORD), "--wait", str(_START_S)),
        *_description_argv(plan),
        *(("--log-time", "simulated") if plan.mode == "lockstep" else ()),
        *(
            word
            for name in (MARKER, SETTINGS, SCENARIO)
            for word in ("--attach", str(folder / name))
        ),
        *("--endpoints", str(endpoints)),
    ]


def await_recorder(recorder: Child, *, events: SimpleQueue[Event]) -> None:
    """Wait until the recorder is ready, or has ended, or the wait is over.

    Events of other children are kept for later.
    """
    others: list[Event] = []
    end = time.monotonic() + _START_S
    while True:
        try:
            event = events.get(timeout=max(0.0, end - time.monotonic()))
        except Empty:
            _LOG.warning(
                f"recorder: not ready within {_START_S:g} s; the run begins without "
                "it, and the start may be missing from the record"
            )
            break
        if isinstance(event, Ready):
            break
        if not isinstance(event, Exit) or event.child is not recorder:
            others.append(event)
        # If the recorder has ended, the user is told at the end of the run.
        if isinstance(event, Exit):
            break
    for event in others:
        events.put(event)


def see_recorder_off(recorder: Child) -> None:
    """Wait until the record is complete; warn if it is not."""
    code = recorder.wait(_FINISH_S)
    if code is None:
        _LOG.warning(f"recorder: did not end within {_FINISH_S:g} s after the run")
        return
    # The folder is renamed at the end of the run.
    here = f"{recorder.log.parent}/"
    lines = [line.replace(here, "") for line in recorder.last_lines()]
    is_whole = (recorder.log.parent / RECORD).is_file()
    if is_whole:
        for line in lines:
            if " WARNING " in line:
                _LOG.warning(f"recorder: {line}")
        return
    how = how_ended(code)
    words = "".join(f"\n  {line}" for line in lines[-3:])
    _LOG.warning(f"recorder: {how}; the run went on, its record is cut off{words}")


def start_live_page(
    plan: RunPlan,
    folder: Path,
    *,
    endpoints: Path,
    port: int,
    events: SimpleQueue[Event],
) -> Child:
    """Start the page and wait until it is served: it then misses no message.

    Returns:
        The process; the run goes on even if it ends.

    Raises:
        ChildFailedError: the page could not be served.
    """
    words = ["view", *_description_argv(plan), "--port", str(port)]
    words += ["--endpoints", str(endpoints)]
    child = Child("view", words, log=folder / "view.log", events=events)
    deadline = time.monotonic() + _START_S
    try:
        while True:
            event = events.get(timeout=max(0.0, deadline - time.monotonic()))
            if isinstance(event, Exit):
                raise failure(child, event.code)
            if isinstance(event, Said):
                _LOG.info(f"live page: {event.url}")
                return child
    except Empty:
        child.stop()
        raise ChildFailedError(
            f"view: the page was not there within {_START_S:g} s",
            exit_code=ExitCode.FAILED,
        ) from None
    except BaseException:
        child.stop()
        raise


class BusRun(NamedTuple):
    """Results of the two processes.

    Attributes:
        sides: their figures; None if the robot's process left nothing.
        error: the error that cut the run short; None for a complete run.
    """

    sides: Sides | None
    error: ChildFailedError | KeyboardInterrupt | None


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
) -> BusRun:
    """Start robot, recorder and stabilizer, wait for the end, stop all.

    Neither waits a fixed time for the other: the stabilizer dials until the robot's
    liveliness token is there, and the robot's clock starts with its commander.

    Args:
        plan: what to run.
        folder: holds the settings file; gets logs and the record.
        endpoints: where the two meet.
        record: write every tick; a separate recorder writes the bus. A failure of the
            recorder is reported and never ends the run.
        on_tick: called with the robot's tick from time to time.
        view_port: serve a live page of the run at this port; None for no page.
        histogram: whether the results hold histograms of all times.
        priority: of SCHED_FIFO for the two, the recorder next; None for ordinary
            processes.

    Returns:
        The figures, also of a run that was cut short, and the error that cut it short.
    """
    plant_file, controller_file = folder / "plant.json", folder / "controller.json"
    relay_file = folder / "relay.json"
    beyond = endpoints if plan.relay_path is None else loopback_endpoints()
    meeting, beyond_file = folder / ENDPOINTS, folder / f"beyond-{ENDPOINTS}"
    write_endpoints(meeting, endpoints)
    write_endpoints(beyond_file, beyond)
    shared = [*_description_argv(plan), f"--{plan.mode}"]
    scenario = str(plan.scenario_path or folder / SCENARIO)
    if histogram:
        shared.append("--histogram")
    if priority is not None:
        shared += ["--realtime-priority", str(priority)]
    robot_argv = [
        *("robot", scenario, "--seed", str(plan.seed), *shared),
        *("--endpoints", str(meeting)),
        *("--result-file", str(plant_file)),
    ]
    stabilizer_argv = [
        *("stabilizer", "--controller", plan.controller, "--wait", str(_START_S)),
        *(("--walk", scenario) if plan.scenario.walk is not None else ()),
        *shared,
        *("--endpoints", str(beyond_file)),
        *("--settings", str(folder / SETTINGS)),
        *("--result-file", str(controller_file)),
    ]
    if record:
        robot_argv += ["--record-file", str(folder / TICKS)]
        stabilizer_argv += ["--record-file", str(folder / CONTROLLER_TICKS)]
    events: SimpleQueue[Event] = SimpleQueue()
    children: list[Child] = []
    error: ChildFailedError | KeyboardInterrupt | None = None
    relay: Child | None = None

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
        robot = start("robot", robot_argv)
        recorder = None
        if record:
            words = recorder_argv(plan, folder, meeting)
            if priority is not None and priority > 1:
                words += ["--realtime-priority", str(priority - 1)]
            recorder = start("recorder", words)
            await_recorder(recorder, events=events)
        if plan.relay_path is not None:
            words = _relay_argv(plan, plan.relay_path, endpoints, beyond)
            relay = start("relay", [*words, "--result-file", str(relay_file)])
        stabilizer = start("stabilizer", stabilizer_argv)
        supervise(robot, stabilizer, events=events, on_tick=on_tick, between=relay)
        if recorder is not None:
            see_recorder_off(recorder)
    except (ChildFailedError, KeyboardInterrupt) as cut:
        error = cut
    finally:
        for child in children:
            child.ask_to_end()
        for child in children:
            child.stop()
    sides = None
    if plant_file.is_file():
        has_answered = controller_file.is_file()
        sides = Sides(
            plant=read_struct(plant_file, PlantResult),
            controller=(
                read_struct(controller_file, ControllerResult) if has_answered else None
            ),
            relay=_relay_result(relay, relay_file, error),
        )
        if error is not None:
            sides = _ended_by(error, sides)
    for file in (plant_file, controller_file, relay_file, meeting, beyond_file):
        file.unlink(missing_ok=True)
    return BusRun(sides, error)


def _ended_by(error: ChildFailedError | KeyboardInterrupt, sides: Sides) -> Sides:
    """Add the cause of the end if the robot only knows that it was asked to end."""
    plant = sides.plant
    if plant.end is not ModeCause.STOPPED:
        return sides
    first_line = next(iter(str(error).splitlines()), signal.SIGINT.name)
    return sides._replace(plant=replace(plant, end_detail=first_line))


def _relay_result(
    relay: Child | None, file: Path, error: BaseException | None
) -> RelayResult | None:
    """Return the relay's counts; None without a relay, or if it was cut short.

    Raises:
        ChildFailedError: the relay ended by itself and left nothing.
    """
    if relay is None:
        return None
    if file.is_file():
        return read_struct(file, RelayResult)
    if error is None:
        raise failure(relay, relay.wait(0.0) or ExitCode.FAILED)
    return None


def _relay_argv(
    plan: RunPlan, relay_path: Path, robots: Endpoints, beyond: Endpoints
) -> list[str]:
    """Command line of the relay: it dials the robot and listens for the stabilizer."""
    return [
        *("relay", str(relay_path), *_description_argv(plan)),
        *("--seed", str(plan.seed), "--wait", str(_START_S)),
        *(word for locator in robots.connect for word in ("--connect", locator)),
        *(word for locator in beyond.listen for word in ("--listen", locator)),
    ]


def _description_argv(plan: RunPlan) -> list[str]:
    """Arguments that describe the robot, the same for every process of a run."""
    profile = plan.robot.file.servo.profile
    return ["--robot", plan.robot_name, "--servo-profile", profile]
