"""``surefoot robot``: the simulated robot alone, for a stabilizer elsewhere."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode, exit_code_for

if TYPE_CHECKING:
    from surefoot.outcome import Judgement
    from surefoot.schemas.result import PlantResult


def robot(
    scenario: options.ScenarioArgument = "standing",
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    seed: options.SeedOption = 0,
    lockstep: options.LockstepOption = True,
    endpoints: options.EndpointsOption = None,
    listen: options.ListenOption = None,
    router: options.RouterOption = None,
    insecure: options.InsecureOption = False,
    histogram: options.HistogramOption = False,
    cpu: options.CpuOption = None,
    realtime_priority: options.PriorityOption = None,
    as_json: options.JsonOption = False,
    child: options.ChildOption = False,
    result_file: options.ResultFileOption = None,
    record_file: options.RecordFileOption = None,
) -> None:
    """Run the simulated robot alone; it waits for a stabilizer to take command.

    Exits with 5 when the robot fell, with 1 when it was in fault, held or not
    commanded at the end.
    """
    from msgspec.structs import replace

    from surefoot.cli.logs import log_note, set_up_logging
    from surefoot.cli.options import check_priority, claim_processor
    from surefoot.endpoints import choose_endpoints
    from surefoot.outcome import judge
    from surefoot.processes.child import begin_as_child, progress_reporter
    from surefoot.robot_io.realtime import Pace
    from surefoot.robot_io.robot import load_robot
    from surefoot.robot_io.ticks.write import TickFile
    from surefoot.run_folder import write_struct
    from surefoot.schemas.scenario import load_scenario
    from surefoot.sim_robot.catalogue import find_scenario, naming_scenario

    set_up_logging("robot")
    if child:
        begin_as_child()
    check_priority(realtime_priority, lockstep=lockstep)
    model = load_robot(robot, servo_profile=servo_profile)
    path = find_scenario(scenario)
    world = load_scenario(path)
    meeting = choose_endpoints(
        endpoints,
        listen=listen or [],
        connect=[],
        router=router,
        insecure=insecure,
    )
    log_note(
        f"{model.file.name} in {scenario!r} waits for a stabilizer at "
        f"{', '.join(meeting.router or meeting.listen)}"
    )
    claim_processor(cpu=cpu, priority=realtime_priority)
    from surefoot.sim_robot.robot_loop import (
        run_robot,  # slow import; report bad files first
    )

    with (
        naming_scenario(path),
        nullcontext()
        if record_file is None
        else TickFile(record_file, may_wait=lockstep) as ticks,
    ):
        done = run_robot(
            model,
            world,
            seed=seed,
            endpoints=meeting,
            pace=Pace.LOCKSTEP if lockstep else Pace.REALTIME,
            ticks=ticks,
            histogram=histogram,
            on_tick=progress_reporter() if child else None,
        )
    result = done.result
    if ticks is not None:
        result = replace(result, unrecorded_ticks=ticks.lost_ticks)
    if result_file is not None:
        write_struct(result_file, result)
    judgement = judge(result, is_realtime=not lockstep, period_s=model.period_s)
    code = exit_code_for(judgement.outcome)
    if child and code is ExitCode.FAILED:
        raise typer.Exit(ExitCode.OK)  # its parent knows of both sides, and judges
    if not child:
        _show(result, scenario, judgement, as_json=as_json)
    raise typer.Exit(code)


def _show(
    result: PlantResult, scenario: str, judgement: Judgement, *, as_json: bool
) -> None:
    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.summary import histogram_table, plant_table

    if as_json:
        print_json(result)
    else:
        print_table(plant_table(result, judgement, title=scenario))
        for name, histogram in result.histograms.items():
            print_table(histogram_table(name, histogram))
