"""``surefoot router``, ``relay`` and ``certs``: links of robot and stabilizer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options
from surefoot.errors import ExitCode

if TYPE_CHECKING:
    from surefoot.schemas.endpoints import Endpoints
LISTEN = "tcp/127.0.0.1:7448"
"""Where the relay listens; it dials the robot at the robot's default locator."""


def router(
    robot: options.RobotOption = "walker",
    endpoints: options.EndpointsOption = None,
    listen: options.ListenOption = None,
    insecure: options.InsecureOption = False,
    child: options.ChildOption = False,
) -> None:
    """Run a router that robot, stabilizer and others dial.

    With TLS it enforces who may publish what, as the robot does without a router.
    """
    from surefoot.processes.child import begin_process, log_note
    from surefoot.robot_io.bus.session import run_router
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.robot_io.robot import load_robot
    from surefoot.schemas.endpoints import choose_endpoints

    begin_process("router", child=child)
    model = load_robot(robot)
    meeting = choose_endpoints(endpoints, listen=listen, insecure=insecure)
    log_note(f"router for {model.file.name} listens on {', '.join(meeting.listen)}")
    run_router(model, endpoints=meeting, stop=StopRequest())
    raise typer.Exit(ExitCode.INTERRUPTED)


def relay(
    plan: Annotated[
        str, typer.Argument(help="Shipped relay plan, or a plan file (.toml).")
    ],
    robot: options.RobotOption = "walker",
    servo_profile: options.ServoOption = None,
    seed: Annotated[
        int, typer.Option("--seed", min=0, help="Seed of the plan's random faults.")
    ] = 0,
    wait_s: options.WaitOption = 10.0,
    endpoints: options.EndpointsOption = None,
    listen: Annotated[
        list[str] | None,
        options.locators_option(
            "--listen", f"The stabilizer dials here; {LISTEN} when absent."
        ),
    ] = None,
    listen_endpoints: Annotated[
        Path | None,
        typer.Option(
            "--listen-endpoints",
            metavar="FILE",
            help="Endpoint file for listening, with the robot's identity; needed with "
            "TLS, where --endpoints dials with the stabilizer's.",
            rich_help_panel="Bus",
        ),
    ] = None,
    connect: options.ConnectOption = None,
    insecure: options.InsecureOption = False,
    as_json: options.JsonOption = False,
    child: options.ChildOption = False,
    result_file: options.ResultFileOption = None,
) -> None:
    """Lose, delay, reorder or corrupt messages between robot and stabilizer.

    Dials the robot, and listens for the stabilizer in the robot's place, until Ctrl-C.
    Time in the plan counts from the first joint command; before it all messages pass.
    Meant for real time: in lockstep the robot waits two seconds for each lost command.
    Exits with 4 when there is no robot, with 130 after Ctrl-C.
    """
    from surefoot.cli.console import print_result
    from surefoot.cli.summary import relay_table
    from surefoot.out_folder import write_json
    from surefoot.processes.child import begin_process, log_note, report_ready
    from surefoot.robot_io.realtime import StopRequest
    from surefoot.robot_io.relay.relay import Relay, find_plan
    from surefoot.robot_io.robot import load_robot
    from surefoot.schemas.relay_plan import load_relay_plan

    begin_process("relay", child=child)
    faults = load_relay_plan(find_plan(plan))
    model = load_robot(robot, servo_profile=servo_profile)
    dialing, listening = _both_sides(
        endpoints,
        listen_endpoints,
        listen=listen,
        connect=connect,
        insecure=insecure,
    )
    ours, robots = ", ".join(listening.listen), ", ".join(dialing.connect)
    log_note(f"{faults.name!r}: dials {robots} for {wait_s:g} s at most")

    def on_ready() -> None:
        log_note(f"the stabilizer of {model.file.name} may dial {ours}")
        if child:
            report_ready()

    result = Relay(model, faults, seed=seed).run(
        dialing,
        listening=listening,
        stop=StopRequest(),
        wait_s=wait_s,
        on_ready=on_ready,
    )
    if result_file is not None:
        write_json(result_file, result)
    if not child:
        print_result(result, lambda: relay_table(result), as_json=as_json)
    raise typer.Exit(ExitCode.INTERRUPTED)


def _both_sides(
    file: Path | None,
    listen_file: Path | None,
    *,
    listen: list[str] | None,
    connect: list[str] | None,
    insecure: bool,
) -> tuple[Endpoints, Endpoints]:
    """Return endpoints to dial the robot and to listen at; they must differ."""
    from surefoot.errors import UsageError
    from surefoot.schemas.endpoints import choose_endpoints

    if file is None and listen_file is None and not listen:
        listen = [LISTEN]
    dialing = choose_endpoints(file, connect=connect, insecure=insecure)
    if dialing.tls is not None and listen_file is None:
        raise UsageError(
            f"{file}: with [tls] a relay has two identities; name the file it listens "
            "with, as the robot, with --listen-endpoints"
        )
    place = listen_file or file
    listening = choose_endpoints(place, listen=listen, insecure=insecure)
    same = set(listening.listen) & set(dialing.router or dialing.connect)
    if same:
        raise UsageError(
            f"the relay would dial itself at {', '.join(sorted(same))}; say where it "
            "listens for the stabilizer with --listen, and where the robot is with "
            "--connect"
        )
    return dialing, listening


def certs(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Folder for certificates and keys."),
    ],
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            metavar="NAME",
            help="Name or address at which robot or router are dialed, besides "
            "loopback and, with --renew, those so far. May be repeated.",
        ),
    ] = None,
    days: Annotated[
        int, typer.Option(min=1, max=3000, help="How long certificates are valid.")
    ] = 365,
    renew: Annotated[
        bool,
        typer.Option(
            "--renew", help="Make new certificates with the existing authority."
        ),
    ] = False,
) -> None:
    """Make certificates for robot, router, stabilizer, operator, planner and observer.

    Give each process its own pair and ca.pem. Keep ca.key.pem off the robot: whoever
    has it can make certificates that command the robot.
    """
    from surefoot.cli.console import print_note
    from surefoot.robot_io.security.certificates import (
        make_certificates,
        renew_certificates,
    )
    from surefoot.robot_io.security.own_certificates import names_of, read_certificates

    make = renew_certificates if renew else make_certificates
    written = make(out, hosts=hosts or [], days=days)
    names = names_of(read_certificates(out / "robot.pem")[0])
    print_note(
        f"{out}: {len(written)} files, valid for {days} days; the robot may be dialed "
        f"as {', '.join(names)}. Keep ca.key.pem away from robot and stabilizer; it is "
        "needed for --renew alone."
    )
