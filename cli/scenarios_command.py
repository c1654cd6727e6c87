"""``surefoot scenarios``: what can be run by name."""

from __future__ import annotations

from cli import options


def scenarios(as_json: options.JsonOption = False) -> None:
    """List the shipped scenarios."""
    from cli.console import print_json, print_table
    from cli.summary import ScenarioRow, scenario_table
    from schemas.scenario import load_scenario
    from sim_robot.catalogue import find_scenario, list_scenarios

    rows = []
    for name in list_scenarios():
        scenario = load_scenario(find_scenario(name))
        text = scenario.description or scenario.name
        rows.append(ScenarioRow(name, scenario.duration_s, text))
    if as_json:
        print_json([row._asdict() for row in rows])
    else:
        print_table(scenario_table(rows))
