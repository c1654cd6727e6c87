"""``surefoot tare``: the offsets of the ankle sensors, of feet off the ground."""

from __future__ import annotations

from typing import Annotated

import typer

from surefoot.cli import options


def tare(
    robot: options.RobotOption = "walker",
    endpoints: options.EndpointsOption = None,
    connect: options.ConnectOption = None,
    wait_s: Annotated[
        float,
        typer.Option(
            "--wait", min=0.1, metavar="SECONDS", help="How long to look for the robot."
        ),
    ] = 10.0,
    foot: Annotated[
        str,
        typer.Option("--foot", metavar="left|right|both", help="What hangs free."),
    ] = "both",
    duration_s: Annotated[
        float,
        typer.Option("--duration", min=0.1, metavar="S", help="How long to average."),
    ] = 2.0,
    as_json: options.JsonOption = False,
) -> None:
    """Measure what the ankle sensors read while the feet hang free, and store it.

    Beside the robot file, as NAME.tare.toml; the driver takes it off from its next
    start on. Nothing is commanded. Exits with 2 when a foot stands or moves.
    """
    from surefoot.cli.console import print_json, print_text
    from surefoot.endpoints import choose_endpoints
    from surefoot.errors import UsageError
    from surefoot.robot_io.robot import load_robot
    from surefoot.tare import measure_tare

    if foot not in ("left", "right", "both"):
        raise UsageError(f"--foot {foot}: expected left, right or both")
    found = measure_tare(
        load_robot(robot),
        endpoints=choose_endpoints(endpoints, listen=[], connect=connect or []),
        foot=foot,  # type: ignore[arg-type]  # checked above
        duration_s=duration_s,
        timeout_s=wait_s,
    )
    if as_json:
        print_json(
            {
                "path": str(found.path),
                "readings": found.readings,
                "left": found.tare.left,
                "right": found.tare.right,
            }
        )
        return
    for name, off in zip(("left", "right"), found.found, strict=True):
        if foot in (name, "both"):
            forces = ", ".join(f"{value:.1f}" for value in off[:3])
            moments = ", ".join(f"{value:.2f}" for value in off[3:])
            print_text(f"{name}: {forces} N; {moments} N m beside what was known")
    print_text(f"{found.readings} readings; stored in {found.path}")
    print_text("The robot's driver takes it off from its next start on.")
