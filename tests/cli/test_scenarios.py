from __future__ import annotations

import json
import re
from pathlib import Path

from surefoot.robot_io.robot import list_robots, load_robot
from surefoot.schemas.scenario import load_scenario
from surefoot.schemas.settings import ControllerSettings, setting_names
from surefoot.sim_robot.catalogue import find_scenario, list_scenarios
from tests.command import Surefoot


def test_every_shipped_scenario_is_listed(surefoot_here: Surefoot) -> None:
    done = surefoot_here("scenarios")
    assert done.returncode == 0
    assert done.stderr == ""
    for name in list_scenarios():
        duration = load_scenario(find_scenario(name)).duration_s
        (line,) = (row for row in done.stdout.splitlines() if row.split()[:1] == [name])
        assert f"{duration:g} s" in line


def test_the_list_is_json_on_request(surefoot_here: Surefoot) -> None:
    done = surefoot_here("scenarios", "--json")
    rows = json.loads(done.stdout)
    assert [row["name"] for row in rows] == list_scenarios()
    assert all(row["description"] for row in rows)


def test_every_shipped_robot_is_listed(surefoot_here: Surefoot) -> None:
    rows = json.loads(surefoot_here("robots", "--json").stdout)
    assert [row["name"] for row in rows] == list_robots()
    for row in rows:
        model = load_robot(row["file"])
        assert row["joints"] == len(model.joint_names)
        assert row["tick_ms"] == 1e3 * model.period_s
    told = surefoot_here("robots").stdout
    assert all(name in told for name in list_robots())


def test_every_setting_is_listed_with_what_it_does(surefoot_here: Surefoot) -> None:
    rows = json.loads(surefoot_here("settings", "--json").stdout)
    assert [row["name"] for row in rows] == setting_names()
    assert all(row["text"] for row in rows)
    defaults = {row["name"]: row["default"] for row in rows}
    assert defaults["tsid.base_kp"] == ControllerSettings().tsid.base_kp
    assert "walk.cross_ahead_m" in surefoot_here("settings").stdout


def test_units_and_names_are_printed_as_they_are_written(
    surefoot_here: Surefoot, tmp_path: Path
) -> None:
    """In brackets they are not taken for colours."""
    listed = surefoot_here("settings").stdout
    assert " ".join(listed.split()).count("[m]") > 5
    told = surefoot_here("settings", "--json")
    units = set(re.findall(r"\[[a-z/]+\]", told.stdout))
    assert units
    assert all(unit in listed for unit in units)
    name = "a [m] :ship: [red]"
    (scenario := tmp_path / "named.toml").write_text(
        f'name = "{name}"\nduration_s = 0.1\n'
    )
    done = surefoot_here("run", scenario, "--inline", "--out", tmp_path / name)
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / name) in done.stdout
