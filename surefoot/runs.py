"""Runs in one process or as two on the bus, for notebooks and ``surefoot run``."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from surefoot.controllers import controller_for, name_of, settings_for
from surefoot.errors import ChildFailedError, RunInterrupted, UsageError
from surefoot.out_folder import OutFolder
from surefoot.outcome import join_result
from surefoot.robot_io.realtime import StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.run_folder import (
    copy_rest,
    folder_of_run,
    read_run,
    run_folder,
    write_inputs,
    write_result,
)
from surefoot.run_plan import Mode, RunPlan, Settings, make_plan
from surefoot.schemas.reasons import Outcome
from surefoot.schemas.result import RunResult
from surefoot.schemas.scenario import Scenario
from surefoot.signals import Signals, TickSinks, file_sinks, memory_sinks, read_signals
from surefoot.stabilizer.factory import check_controller

if TYPE_CHECKING:
    from surefoot.schemas.endpoints import Endpoints


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes:
        result: its figures; see :class:`RunResult`.
        plan: robot, scenario, controller, settings and seed.
        folder: where the run is kept; None while it is only in memory.
        recorded: its signals; None unless they are in memory.
        error: exception of its controller in this process, which ended in order; None
            without one.
    """

    result: RunResult
    plan: RunPlan
    folder: Path | None = None
    recorded: Signals | None = None
    error: Exception | None = None

    def __repr__(self) -> str:
        """Return inputs and outcome in short; the full run would fill pages."""
        r = self.result
        return (
            f"<Run of {r.scenario}: {r.robot}, {r.controller}, seed {r.seed}; "
            f"{r.outcome} {r.outcome_detail}>"
        )

    @cached_property
    def signals(self) -> Signals:
        """Its signals at every tick, by name; ``signals.describe()`` lists them.

        Raises:
            UsageError: it kept no signals, or they cannot be read.
        """
        if self.recorded is not None:
            return self.recorded
        if self.folder is None:
            raise UsageError(
                "this run kept no signals; make it with record=True, or with a folder"
            )
        return read_signals(self.folder)

    @property
    def outcome(self) -> Outcome:
        """Its outcome: ``stood``, ``fell``, ``held``, ...; see :class:`Outcome`."""
        return self.result.outcome

    def save(self, folder: str | Path, *, overwrite: bool = False) -> Run:
        """Save it in a folder, as ``surefoot run --out`` does.

        Of a run that is in a folder, all its files are copied: its record of the bus,
        its logs, and what tells when, by which command and with which packages it was.

        Args:
            folder: a new or empty one.
            overwrite: replace the files of a former run there.

        Returns:
            The saved run.

        Raises:
            UsageError: the folder cannot be used, the robot's file does not hold the
                robot, or the run was made without ``record=True``.
        """
        signals = self.signals
        reads = [*self.plan.files]
        if self.folder is not None:
            reads += self.folder.glob("*")
        with run_folder(Path(folder), reads=reads, overwrite=overwrite) as place:
            write_inputs(place.path, self.plan)
            with file_sinks(place.path) as sinks:
                signals.copy_to(sinks)
            if self.folder is not None:
                copy_rest(self.folder, place.path)
            result = write_result(place, self.result)
        return Run(result, self.plan, Path(folder))

    @property
    def robot(self) -> Robot:
        """The robot, as its files describe it."""
        return self.plan.robot

    @property
    def scenario(self) -> Scenario:
        """The scenario of the run."""
        return self.plan.scenario


def simulate(
    robot: str | Path | Robot = "walker",
    scenario: str | Path | Scenario = "standing",
    *,
    controller: Any = "whole-body",
    settings: Settings = None,
    servo_profile: str | None = None,
    seed: int = 0,
    relay: str | None = None,
    record: bool = True,
    on_tick: Callable[[int], None] | None = None,
) -> Run:
    """Run a scenario in this process, without the bus.

    Args:
        robot: shipped name, path of a robot file, or a loaded robot.
        scenario: shipped name, path of a TOML, or a scenario built in Python.
        controller: a name as on the command line, a class that is called with robot
            and settings, or a fresh object with ``start(snapshot, q_command)`` and
            ``step(snapshot, reference)``.
        settings: ``{"tsid.com_kp": 40.0}``, resolved settings, the name of shipped
            settings, a file, or None for the defaults. An object has been made with
            its own: it gets only those of the safety layer, the calibration and walk.
        servo_profile: a profile of the robot file to use instead of its own choice.
        seed: of the sensor noise, 0 or more.
        relay: a shipped relay plan or the path of one; its faults act in simulated
            time.
        record: keep every tick's signals.
        on_tick: called with each tick.

    Returns:
        The run, the same bit for bit as on the bus in lockstep.

    Raises:
        ScenarioError: no such scenario, or it does not fit the robot.
        RobotFileError: no such robot, or its files contradict each other.
        FileFormatError: a file or a setting is malformed.
        ControllerError: no such controller, or it breaks the controller protocol.
        UsageError: settings or servo profile do not reach the controller.
    """
    plan = make_plan(
        scenario,
        robot=robot,
        servo_profile=servo_profile,
        controller=name_of(controller),
        settings=settings_for(controller, settings),
        seed=seed,
        relay=relay,
    )
    return run_inline(plan, controller=controller, record=record, on_tick=on_tick)


def run_inline(
    plan: RunPlan,
    *,
    controller: Any = None,
    record: bool = False,
    folder: Path | None = None,
    histogram: bool = False,
    goes_on: bool = False,
    on_tick: Callable[[int], None] | None = None,
) -> Run:
    """Run a plan in this process.

    Args:
        plan: what to run.
        controller: see :func:`simulate`; the plan's when None.
        record: keep every tick's signals.
        folder: gets the record and a QP that could not be solved; None keeps both in
            memory.
        histogram: whether the result holds a histogram of the controller's times.
        goes_on: whether a controller that raises is given up in order, as on the bus;
            otherwise its exception is raised.
        on_tick: called with each tick.

    Raises:
        RunInterrupted: Ctrl-C or SIGTERM; the error holds the run so far.
    """
    if plan.relay is None:
        from surefoot.simulation import Simulation as Kind
    else:
        from surefoot.relayed_simulation import RelayedSimulation as Kind

    with _sinks(folder) if record else nullcontext() as sinks:
        sim = Kind.of_plan(plan, sinks=sinks)
        sim.goes_on = goes_on
        law = controller_for(plan, controller)
        stop = StopRequest()
        with stop.on_signals():
            sim.run(law, on_tick=on_tick, stop=stop)
    if folder is not None:
        sim.write(folder)
    done = Run(
        result=sim.result(histogram=histogram),
        plan=plan,
        recorded=sim.signals if record and folder is None else None,
        error=None if sim.safety is None else sim.safety.error,
    )
    if stop.is_set and not sim.finished:
        raise RunInterrupted(done)
    return done


def run(
    robot: str | Path | Robot = "walker",
    scenario: str | Path | Scenario = "standing",
    *,
    controller: str = "whole-body",
    settings: Settings = None,
    servo_profile: str | None = None,
    seed: int = 0,
    realtime: bool = False,
    relay: str | None = None,
    out: str | Path | None = None,
    on_tick: Callable[[int], None] | None = None,
) -> Run:
    """Run a scenario as two processes that meet on a bus of their own.

    Args:
        robot: shipped name or path of a robot file, or a robot loaded from one.
        scenario: shipped name, path of a TOML, or a scenario built in Python.
        controller: a name as on the command line: ``whole-body``,
            ``package.module:Class``, ``path/to/file.py:Class``.
        settings: as for :func:`simulate`.
        servo_profile: a profile of the robot file to use instead of its own choice.
        seed: of the sensor noise, 0 or more.
        realtime: the robot keeps its own pace instead of waiting for each command.
        relay: a shipped relay plan or the path of one; in real time only.
        out: a new folder that keeps the run with every message of the bus; None
            keeps nothing on disk.
        on_tick: called with the robot's tick from time to time.

    Raises:
        ChildFailedError: a process failed; the message quotes its last lines.
        UsageError: the folder cannot be used, or the file does not hold the robot.
    """
    mode: Mode = "realtime" if realtime else "lockstep"
    plan = make_plan(
        scenario,
        robot=robot,
        servo_profile=servo_profile,
        controller=controller,
        settings=settings_for(controller, settings),
        seed=seed,
        mode=mode,
        relay=relay,
    )
    return execute(plan, out=None if out is None else Path(out), on_tick=on_tick)


def load_run(folder: str | Path) -> Run:
    """Load a run from its folder.

    Args:
        folder: the folder given to ``out`` or ``surefoot run --out``, or a file in it.

    Raises:
        UsageError: it is not a finished run, or damaged.
    """
    whole = folder_of_run(Path(folder))
    return Run(*read_run(whole), folder=whole)


def execute(
    plan: RunPlan,
    *,
    out: Path | None = None,
    overwrite: bool = False,
    endpoints: Endpoints | None = None,
    view_port: int | None = None,
    histogram: bool = False,
    priority: int | None = None,
    on_tick: Callable[[int], None] | None = None,
) -> Run:
    """Run a plan in its mode, and keep its folder.

    Args:
        plan: what to run.
        out: a new folder that keeps everything; None keeps nothing.
        overwrite: replace the files of a former run there.
        endpoints: where two processes meet; on a private bus when None.
        view_port: serve a live page of two processes at this port; None for no page.
        histogram: whether the result holds histograms of all times.
        priority: of SCHED_FIFO for two processes; None for ordinary ones.
        on_tick: called with the present tick from time to time.

    Raises:
        ChildFailedError: one of the processes failed; the folder keeps the logs, and
            the error holds the run so far.
        RunInterrupted: Ctrl-C or SIGTERM; the folder keeps the record, and the error
            holds the run so far.
        UsageError: the folder cannot be used, or the file does not hold the robot.
        EndpointError: the endpoints cannot.
    """
    check_controller(plan.controller)
    if endpoints is not None:
        from surefoot.robot_io.bus.session import Role, check_endpoints

        for role in (Role.ROBOT, Role.CLIENT):
            check_endpoints(endpoints, role)
    on_tick = on_tick or (lambda tick: None)
    with run_folder(out, reads=plan.files, overwrite=overwrite) as folder:
        write_inputs(folder.path, plan)
        result: RunResult | None
        error: ChildFailedError | KeyboardInterrupt | None = None
        raised: Exception | None = None
        if plan.mode == "inline":
            inline, error = _inline(plan, folder, histogram=histogram, on_tick=on_tick)
            result, raised = inline.result, inline.error
        else:
            folder.keep()  # the user needs the logs of a failed run
            from surefoot.processes.bus_run import run_processes
            from surefoot.robot_io.bus.bus import private_bus

            bus = private_bus() if endpoints is None else nullcontext(endpoints)
            with bus as meeting:
                sides, error = run_processes(
                    plan,
                    folder.path,
                    endpoints=meeting,
                    record=out is not None,
                    on_tick=on_tick,
                    view_port=view_port,
                    histogram=histogram,
                    priority=priority,
                )
            result = None if sides is None else join_result(plan, sides)
        run = None
        if result is not None:
            run = Run(write_result(folder, result), plan, out, error=raised)
        if isinstance(error, KeyboardInterrupt):
            raise RunInterrupted(run) from error
        if error is not None:
            error.run = run
            raise error
        assert run is not None
        return run


def _inline(
    plan: RunPlan,
    folder: OutFolder,
    *,
    histogram: bool,
    on_tick: Callable[[int], None],
) -> tuple[Run, KeyboardInterrupt | None]:
    """Run in this process, in a folder; return the run and what cut it short."""

    def begun(tick: int) -> None:
        folder.keep()
        on_tick(tick)

    try:
        run = run_inline(
            plan,
            record=folder.out is not None,
            folder=folder.path,
            histogram=histogram,
            goes_on=True,
            on_tick=begun,
        )
    except RunInterrupted as interrupt:
        return interrupt.run, interrupt
    return run, None


def _sinks(folder: Path | None) -> AbstractContextManager[TickSinks]:
    """Sinks of the signals: files in the folder, or memory without one."""
    return nullcontext(memory_sinks()) if folder is None else file_sinks(folder)
