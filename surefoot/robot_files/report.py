"""The whole judgement of a robot file."""

from __future__ import annotations

import msgspec

from surefoot.robot_files.judge import (
    Finding,
    capture_finding,
    quick_findings,
    reach_findings,
)
from surefoot.robot_files.scenario_fit import ScenarioFit, fit
from surefoot.robot_io.robot import Robot
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.catalogue import list_scenarios, load_scenario
from surefoot.stabilizer.margins.margins import compute_margins
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.nominal import capture_limits, reach_search


class RobotFileReport(msgspec.Struct, frozen=True, kw_only=True):
    """A robot file, judged.

    Attributes:
        robot: its name.
        path: of the file.
        findings: line by line.
        scenarios: the shipped ones.
    """

    robot: str
    path: str
    findings: list[Finding]
    scenarios: list[ScenarioFit]


def judge(robot: Robot) -> RobotFileReport:
    """Judge a robot whose files were loaded, and so refused if they contradict."""
    model = RobotModel(robot)
    search, capture = reach_search(model), capture_limits(model)
    fits = []
    for name in list_scenarios():
        found = fit(load_scenario(name), robot, search=search, capture=capture)
        fits.append(msgspec.structs.replace(found, name=name))
    return RobotFileReport(
        robot=robot.file.name,
        path=str(robot.path),
        findings=[
            *quick_findings(robot),
            capture_finding(capture),
            *reach_findings(robot, search.reach()),
            _margins(robot),
        ],
        scenarios=fits,
    )


def _margins(robot: Robot) -> Finding:
    """Tell what the whole-body stabilizer bears with its default settings."""
    found = compute_margins(robot, ControllerSettings())
    return Finding(
        name=f"margins, {found.servo_profile} servos",
        verdict="ok" if found.is_enough else "warning",
        got="; ".join(found.in_words()),
        advice=""
        if found.is_enough
        else "see surefoot margins; softer servos or a quicker loop have more",
    )
