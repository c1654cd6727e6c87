from __future__ import annotations

import json

from surefoot.schemas.scenario import load_scenario
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
