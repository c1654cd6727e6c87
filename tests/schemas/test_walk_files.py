"""The walk of a scenario, and refusals of wrong ones."""

from __future__ import annotations

from typing import Any, get_type_hints

import msgspec
import pytest

from surefoot.cli.process_commands import walk as walk_command
from surefoot.schemas import walk_plan
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import MAX_INCOMING_BYTES
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.schemas.scenario_paths import override_scenario
from surefoot.schemas.walk_plan import Step, Walk, WalkPlan, WalkStep, joined, parts_of

STEPS = [
    {"side": "right", "position_m": [0.1, -0.11]},
    {"side": "left", "position_m": [0.2, 0.11]},
    {"side": "right", "position_m": [0.3, -0.11]},
]


def scenario(duration_s: float = 5.0, **walk: Any) -> Scenario:
    table = {"name": "here", "duration_s": duration_s, "walk": walk}
    return scenario_from_table(table, source="here")


@pytest.mark.parametrize(
    ("walk", "words"),
    [
        (
            {"step": [*STEPS[:2], STEPS[1]]},
            "walk.step[2].side: got 'left', as the step before it; left and right "
            "take turns",
        ),
        (
            {"start_s": 5.0},
            "walk.start_s: got 5, expected earlier than the scenario ends, "
            "`duration_s`, 5",
        ),
        ({"stop_s": 1e11}, "walk.stop_s: got 100000000000.0, expected"),
        ({"velocity_m_s": 1e9}, "walk.velocity_m_s: got 1000000000.0, expected"),
        ({"step_s": 1e-9}, "walk.step_s: got 1e-09, expected a number >= 0.2"),
        ({"double_s": 1e-9}, "walk.double_s: got 1e-09, expected a number >= 0.05"),
        ({"height_m": 1e-9}, "walk.height_m: got 1e-09, expected a number >= 0.01"),
        (
            {"step": [{**STEPS[0], "step_s": 0.1}]},
            "walk.step[0].step_s: got 0.1, expected a number >= 0.2",
        ),
    ],
)
def test_a_walk_that_is_none_is_told_with_its_key(
    walk: dict[str, Any], words: str
) -> None:
    with pytest.raises(FileFormatError) as raised:
        scenario(**walk)
    assert str(raised.value).startswith(f"here: {words}")


def test_a_varied_step_takes_its_turn_too() -> None:
    whole = scenario(step=STEPS)
    with pytest.raises(FileFormatError, match=r"walk\.step\[1\]\.side: got 'right'"):
        override_scenario(whole, {"walk.step.1.side": "right"})


def test_a_plan_and_a_scenario_have_the_same_bounds() -> None:
    step = msgspec.json.schema(walk_plan.Step)["$defs"]["Step"]["properties"]
    for table, key, bus in (
        (Walk, "step_s", "single_s"),
        (Walk, "double_s", "double_s"),
        (Walk, "height_m", "height_m"),
    ):
        written = msgspec.json.schema(table)["$defs"]["Walk"]["properties"][key]
        for bound in ("minimum", "maximum"):
            assert written[bound] == step[bus][bound]
    of_walk = msgspec.json.schema(Walk)["$defs"]["Walk"]["properties"]["step"]
    of_plan = msgspec.json.schema(WalkPlan)["$defs"]["WalkPlan"]["properties"]["steps"]
    assert of_walk["maxItems"] == of_plan["maxItems"] == 14400


def test_the_command_line_has_the_bounds_of_files() -> None:
    """Written out there: reading them would make every ``--help`` slow."""
    options = {
        "velocity": "velocity_m_s",
        "lateral": "lateral_m_s",
        "yaw_rate": "yaw_rate_deg_s",
        "step_s": "step_s",
        "double_s": "double_s",
        "height": "height_m",
    }
    hints = get_type_hints(walk_command, include_extras=True)
    fields = msgspec.json.schema(Walk)["$defs"]["Walk"]["properties"]
    for option, key in options.items():
        (typed,) = hints[option].__metadata__
        assert (typed.min, typed.max) == (
            fields[key]["minimum"],
            fields[key]["maximum"],
        )


def test_a_walk_built_in_python_is_checked_as_well() -> None:
    with pytest.raises(ValueError, match="left and right take turns"):
        Walk(step=[WalkStep(side="left", position_m=[0.0, 0.11])] * 2)


def test_a_long_plan_goes_over_the_bus_in_parts_and_is_whole_again() -> None:
    steps = [
        Step(
            id=2**62 + index,
            side="right" if index % 2 else "left",
            position=[0.1 * index, -1e300, 1e-300],
            yaw=0.1,
            single_s=0.3,
            double_s=0.1,
            height_m=0.1,
        )
        for index in range(300)
    ]
    plan = WalkPlan(schema=3, tick=7, stamp_ns=2**62, begin_tick=2**62, steps=steps)
    parts = parts_of(plan, most_bytes=MAX_INCOMING_BYTES)
    assert 1 < len(parts) < 5
    assert max(len(encode(part)) for part in parts) <= MAX_INCOMING_BYTES
    empty = msgspec.structs.replace(plan, steps=[], stamp_ns=3)
    assert parts_of(empty, most_bytes=1024) == [empty]
    assert joined([*parts, empty]) == [plan, empty]
