"""``surefoot scenarios``: what can be run by name."""

from __future__ import annotations

from surefoot.cli import options


def scenarios(as_json: options.JsonOption = False) -> None:
    """List the shipped scenarios."""
    from surefoot.cli.console import print_json, print_table
    from surefoot.cli.summary import ScenarioRow, scenario_table
    from surefoot.schemas.scenario import load_scenario
    from surefoot.sim_robot.catalogue import find_scenario, list_scenarios

    rows = []
    for name in list_scenarios():
        scenario = load_scenario(find_scenario(name))
        text = scenario.description or scenario.name
        rows.append(ScenarioRow(name, scenario.duration_s, text))
    if as_json:
        print_json([row._asdict() for row in rows])
    else:
        print_table(scenario_table(rows))
