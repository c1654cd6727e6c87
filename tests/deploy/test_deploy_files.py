"""The files in deploy/ fit this release."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import typer
import zenoh

from deploy.zenoh.write import FILES, text
from surefoot.cli.app import app
from surefoot.robot_io.robot import load_robot
from surefoot.robot_io.security.locators import (
    access_control,
    check_encryption,
    check_exposure,
    check_locators,
)
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.toml_file import load
from tests.command import REPOSITORY

DEPLOY = REPOSITORY / "deploy"


ENDPOINT_FILES = sorted({*DEPLOY.rglob("*.toml")} - {*DEPLOY.glob("driver/ros2*.toml")})
"""All files except the settings of drivers."""
UNITS = sorted((DEPLOY / "systemd").glob("*"))


@pytest.mark.parametrize("path", ENDPOINT_FILES, ids=str)
def test_endpoint_files_can_be_used(path: Path) -> None:
    endpoints = load(path, Endpoints)
    dialed = endpoints.router or endpoints.connect
    is_routed = bool(endpoints.router) and path.stem != "router"
    for locators in (dialed,) if is_routed else (dialed, endpoints.listen):
        check_locators(locators, verb="use")
        check_encryption(endpoints, locators)
    check_exposure(endpoints)
    if endpoints.tls is not None:
        assert Path(endpoints.tls.certificate).stem == path.stem


@pytest.mark.parametrize("name", FILES)
def test_zenoh_takes_its_configurations_and_they_are_up_to_date(name: str) -> None:
    file = DEPLOY / "zenoh" / f"{name}.json5"
    assert file.read_text(encoding="utf-8") == text(name)
    config = zenoh.Config.from_file(str(file))
    assert config.get_json("scouting/multicast/enabled") == "false"


def test_access_follows_the_robot_files_keys() -> None:
    robot = load_robot("walker-real")
    endpoints = Endpoints()
    rules = access_control(endpoints.access, keys=robot.keys, namespace="walker")
    assert rules["default_permission"] == "deny"
    allowed = {key for rule in rules["rules"] for key in rule["key_exprs"]}
    assert "walker/sensor/ft/lankle" in allowed
    assert "walker/state/ft/left_ankle" not in allowed


def unit_of(path: Path) -> dict[str, str]:
    """Return the last value of each key of a unit."""
    lines = path.read_text(encoding="utf-8").splitlines()
    pairs = (line.partition("=") for line in lines if not line.startswith(("#", "[")))
    return {key: value for key, mark, value in pairs if mark}


@pytest.mark.parametrize("unit", UNITS, ids=lambda path: path.stem)
def test_the_command_line_of_a_unit_parses(unit: Path) -> None:
    _, command, *arguments = shlex.split(unit_of(unit)["ExecStart"])
    known = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    known[command].make_context(command, arguments)  # refuses what it does not know


def test_after_a_fall_or_a_fault_no_unit_takes_command_again() -> None:
    unit = unit_of(DEPLOY / "systemd" / "surefoot-stabilizer.service")
    assert unit["Restart"] == "on-abnormal"  # no exit code starts it, a kill does
    assert "RestartForceExitStatus" not in unit
    assert "--reconnect" in unit["ExecStart"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
@pytest.mark.parametrize("unit", UNITS, ids=str)
def test_systemd_understands_the_units(unit: Path, tmp_path: Path) -> None:
    """With a program that exists here in the place of the installed one."""
    copy = tmp_path / unit.name
    copy.write_text(
        unit.read_text(encoding="utf-8").replace(
            "/opt/surefoot/venv/bin/surefoot", "/bin/true"
        )
    )
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(copy)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert unit.name not in done.stderr
