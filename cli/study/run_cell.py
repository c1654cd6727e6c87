"""Does one run of a study, in whatever process it is called in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from cli.study.cell import Cell, Group

Row = dict[str, Any]
FIGURES = (
    "fell",
    "fell_at_s",
    "duration_s",
    "com_error_rms_mm",
    "com_error_max_mm",
    "base_tilt_max_deg",
    "force_error_rms_n",
    "force_deviation_rms_n",
    "force_peak_n",
    "contact_lost_s",
    "contact_gap_s",
    "qp_failures",
    "log_sha256",
)


def plan_of(cell: Cell, *, robot: str, overrides: tuple[str, ...]) -> Any:
    """The run's plan, as ``surefoot run --inline`` would make it.

    Raises:
        FileFormatError: a value does not fit the scenario.
    """
    from cli.run_plan import RunPlan
    from cli.study.variant import find_variant
    from robot_io.robot import load_robot
    from schemas.scenario import load_scenario
    from schemas.scenario_paths import override_scenario
    from sim_robot.catalogue import find_scenario

    group = cell.group
    path = find_scenario(group.scenario)
    variant = find_variant(group.variant)
    scenario = override_scenario(load_scenario(path), dict(group.values))
    return RunPlan(
        scenario_path=path,
        scenario=scenario,
        robot_name=robot,
        robot=load_robot(robot, servo_profile=group.servo_profile),
        servo_profile=group.servo_profile,
        controller=variant.controller,
        settings=variant.resolve(group.servo_profile, extra=overrides),
        seed=cell.seed,
        mode="inline",
    )


def run_cell(cell: Cell, *, robot: str, overrides: tuple[str, ...]) -> Row:
    """Runs a cell and returns its row: what was run, and the figures."""
    from cli.inline import run_inline
    from cli.join_result import join_result

    plan = plan_of(cell, robot=robot, overrides=overrides)
    sides = run_inline(plan, Path(), record=False, on_tick=_nobody_watches)
    result = join_result(plan, sides.plant, sides.controller, out=None)
    figures = msgspec.to_builtins(result)
    group = cell.group
    return {
        "key": cell.key,
        "scenario": group.scenario,
        "values": dict(group.values),
        "variant": group.variant,
        "servo_profile": group.servo_profile,
        "seed": cell.seed,
        **{name: figures[name] for name in FIGURES},
    }


def group_of(row: Row) -> Group:
    """Which group a row belongs to."""
    values = tuple(row["values"].items())
    return Group(row["scenario"], values, row["variant"], row["servo_profile"])


def _nobody_watches(tick: int) -> None:
    del tick
