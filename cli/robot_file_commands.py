"""``surefoot new-robot`` and ``check-robot-file``: robot files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surefoot.cli import options

if TYPE_CHECKING:
    from rich.table import Table

    from surefoot.robot_files.draft import Note
    from surefoot.robot_files.judge import RobotFileReport

_PARTS = "Parts of the robot"
_JOINTS = "Joints"
_WARNED = "bold yellow"


def new_robot(
    urdf: Annotated[
        Path, typer.Argument(metavar="URDF", help="The robot's URDF file.")
    ],
    left_sole: Annotated[
        str,
        typer.Option(metavar="LINK", help="Left foot, or the frame of its sole."),
    ],
    right_sole: Annotated[
        str, typer.Option(metavar="LINK", help="The same for the right foot.")
    ],
    left_ft: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="Link below the left force-torque sensor. When absent it is found by "
            "name, or the sensor is assumed at the ankle.",
            rich_help_panel=_PARTS,
        ),
    ] = None,
    right_ft: Annotated[
        str | None,
        typer.Option(
            metavar="LINK", help="The same for the right foot.", rich_help_panel=_PARTS
        ),
    ] = None,
    imu: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="Link of the IMU, fixed to the base; found by name when absent.",
            rich_help_panel=_PARTS,
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Name of the robot; the URDF's when absent."),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(metavar="DIR", help="Folder for TOML, URDF and meshes."),
    ] = Path(),
    overwrite: options.OverwriteOption = False,
    fix: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT",
            help="Joint to fix; * stands for any characters. May be repeated.",
            rich_help_panel=_JOINTS,
        ),
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT",
            help="Light joint that is not to be fixed; * stands for any characters. "
            "May be repeated.",
            rich_help_panel=_JOINTS,
        ),
    ] = None,
    legs_only: Annotated[
        bool,
        typer.Option(
            "--legs-only",
            help="Fix all joints above the legs.",
            rich_help_panel=_JOINTS,
        ),
    ] = False,
    rise_m: Annotated[
        float | None,
        typer.Option(
            "--rise",
            min=0.005,
            max=1.0,
            metavar="M",
            help="How far the centre of mass should be able to rise over the feet; "
            "when absent, a share of the leg's length.",
            rich_help_panel=_JOINTS,
        ),
    ] = None,
    sink_m: Annotated[
        float | None,
        typer.Option(
            "--sink",
            min=0.005,
            max=1.0,
            metavar="M",
            help="How far the centre of mass should be able to sink.",
            rich_help_panel=_JOINTS,
        ),
    ] = None,
    package_dir: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            help="Folder that holds packages named in package://. May be repeated.",
        ),
    ] = None,
    repair_inertias: Annotated[
        bool,
        typer.Option(
            "--repair-inertias",
            help="Give links with an impossible inertia the nearest possible one.",
        ),
    ] = False,
    rate_hz: Annotated[
        float,
        typer.Option(
            "--rate",
            min=50.0,
            max=10000.0,
            metavar="HZ",
            help="Rate of the control loop.",
        ),
    ] = 1000.0,
) -> None:
    """Make a robot file from a URDF; tell what was found, guessed and left to you.

    Measures soles, finds sensors, solves a standing posture with bent knees, and
    guesses drives. The URDF itself is not changed.
    """
    from surefoot.cli.console import print_table, print_text
    from surefoot.robot_files.new_robot import NewRobotOptions
    from surefoot.robot_files.new_robot import new_robot as make

    made = make(
        urdf,
        NewRobotOptions(
            left_sole=left_sole,
            right_sole=right_sole,
            left_ft=left_ft,
            right_ft=right_ft,
            imu=imu,
            name=name,
            fix=fix or [],
            keep=keep or [],
            legs_only=legs_only,
            package_dirs=package_dir or [],
            repair_inertias=repair_inertias,
            rise_m=rise_m,
            sink_m=sink_m,
            rate_hz=rate_hz,
        ),
        out=out,
        overwrite=overwrite,
    )
    file = out / made.robot.path.name
    print_table(_table(made.robot.file.name, made.notes))
    print_text(f"\nwritten: {file} and {file.with_suffix('.urdf').name}")
    print_text(f"judge it:       surefoot check-robot-file {file}")
    print_text(f"make it stand:  surefoot run standing --robot {file} --inline")


def _table(name: str, notes: tuple[Note, ...]) -> Table:
    from surefoot.cli.console import new_table
    from surefoot.robot_files.draft import KINDS

    table = new_table(f"{name}: from its URDF", "", "what")
    for kind in KINDS:
        lines = [note.text for note in notes if note.kind == kind]
        for place, line in enumerate(lines):
            table.add_row("" if place else kind, line)
        if lines:
            table.add_section()
    return table


def check_robot_file(
    file: Annotated[
        str, typer.Argument(help="Robot file (.toml), or the name of a shipped robot.")
    ],
    servo_profile: options.ServoOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Check a robot file: masses, axes, posture, reach, servos, shipped scenarios.

    Exits with 2 when the files contradict each other. Warnings do not fail.
    """
    from rich.console import Group

    from surefoot.cli.console import print_result
    from surefoot.robot_files.judge import judge
    from surefoot.robot_io.robot import load_robot
    from surefoot.schemas.settings import ControllerSettings
    from surefoot.stabilizer.margins.margins import compute_margins

    robot = load_robot(file, servo_profile=servo_profile)
    report = judge(robot, compute_margins(robot, ControllerSettings()))
    print_result(
        report,
        lambda: Group(_findings(report), _scenarios(report)),
        as_json=as_json,
    )


def _findings(report: RobotFileReport) -> Table:
    from surefoot.cli.console import new_table, verdict_mark

    warnings = sum(f.verdict == "warning" for f in report.findings)
    title = f"{report.robot}: {warnings or 'no'} warning{'s' * (warnings != 1)}"
    table = new_table(title, "what", "", "found", "do")
    for finding in report.findings:
        mark = verdict_mark(finding.verdict == "ok", "warning", style=_WARNED)
        table.add_row(finding.name, mark, finding.got, finding.advice)
    return table


def _scenarios(report: RobotFileReport) -> Table:
    from surefoot.cli.console import new_table, verdict_mark

    headings = ("scenario", "", "why; --scale-to-robot makes it fit")
    table = new_table("shipped scenarios", *headings)
    for fit in report.scenarios:
        mark = verdict_mark(not fit.why, "out of reach", style=_WARNED)
        table.add_row(fit.name, mark, fit.why)
    return table
