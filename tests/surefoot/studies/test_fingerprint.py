"""A finished run is reused as long as nothing it depends on has changed."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from surefoot.errors import UsageError
from surefoot.studies import store
from surefoot.studies.cell import Cell, Group
from surefoot.studies.execute import execute
from surefoot.studies.store import StudyStore, Task, code_of_a_run, inputs_fingerprint

SHORT = """
name = "short"
duration_s = 0.02
"""
SHAKEN = """
name = "shaken"
duration_s = 0.5
[[platform]]
foot = "both"
[[platform.motion]]
axis = "x"
kind = "recorded"
file = "a.csv"
quantity = "position"
"""
RECORD = "time_s,value\n0.0,0.0\n0.3,0.002\n0.7,0.008\n1.0,0.01\n"
CONTROLLER = """
class Still:
    def start(self, snapshot, q_command):
        self.q = q_command
    def step(self, snapshot, reference):
        return self.q
"""

LOADED = """
import sys
from surefoot.simulation import Simulation
from surefoot.stabilizer.factory import make_controller
for name in ("whole-body", "zmp", "hold"):
    sim = Simulation("walker", "standing")
    sim.step(make_controller(name, sim.plan.robot, sim.plan.settings))
print(*(n for n, module in sys.modules.items() if not hasattr(module, "__path__")))
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


def cell(scenario: Path, controller: str = "hold") -> Cell:
    return Cell(Group(str(scenario), (), controller, "ideal"), 0)


def inputs(cell: Cell, *overrides: str) -> str:
    return inputs_fingerprint(cell.plan(robot="walker", overrides=overrides))


def test_code_of_a_run_is_plant_controller_and_settings() -> None:
    code = code_of_a_run()
    computing = ("sim_robot.plant", "stabilizer.control.dik", "schemas.settings")
    beside = ("cli", "report", "view", "studies", "recording", "robot_io.bus")
    assert all(f"surefoot.{name}" in code for name in computing)
    assert not [
        name
        for name in code
        if any(f"{name}.".startswith(f"surefoot.{room}.") for room in beside)
    ]


def test_every_module_of_plant_and_controller_that_a_run_loads_is_in_it() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, text=True, check=True
    )
    rooms = ("surefoot.sim_robot.", "surefoot.stabilizer.", "surefoot.schemas.settings")
    loaded = {name for name in done.stdout.split() if name.startswith(rooms)}
    assert "surefoot.stabilizer.control.dik" in loaded
    assert loaded <= set(code_of_a_run())


def test_comment_and_docstring_are_not_code_but_a_number_is() -> None:
    def dumped(text: str) -> str:
        return ast.dump(store._without_docstrings(ast.parse(text)))

    plain = dumped("def f(x):\n    return 2 * x\n")
    told = dumped('def f(x):\n    """Double."""\n    # twice\n    return 2 * x\n')
    assert told == plain
    assert dumped("def f(x):\n    return 3 * x\n") != plain


def test_inputs_are_contents_wherever_the_file_lies(
    scenario: Path, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "there" / "short.toml"
    elsewhere.parent.mkdir()
    elsewhere.write_text(f"# a comment\n{SHORT}")
    assert inputs(cell(scenario)) == inputs(cell(elsewhere))
    assert inputs(cell(scenario)) != inputs(cell(scenario), "tsid.base_kp=120")
    before = inputs(cell(scenario))
    scenario.write_text(f"{SHORT}friction = 0.5\n")
    assert inputs(cell(scenario)) != before


def test_recorded_motion_counts_by_its_values_not_by_its_name(tmp_path: Path) -> None:
    scenario, record = tmp_path / "shaken.toml", tmp_path / "a.csv"
    scenario.write_text(SHAKEN)
    record.write_text(RECORD)
    before = inputs(cell(scenario))
    record.rename(tmp_path / "b.csv")
    scenario.write_text(SHAKEN.replace("a.csv", "b.csv"))
    assert inputs(cell(scenario)) == before
    (tmp_path / "b.csv").write_text(RECORD.replace("0.01", "0.02"))
    assert inputs(cell(scenario)) != before


def test_controller_from_a_file_counts_by_its_source(
    scenario: Path, tmp_path: Path
) -> None:
    file = tmp_path / "still.py"
    file.write_text(CONTROLLER)
    before = inputs(cell(scenario, f"{file}:Still"))
    file.write_text(f"{CONTROLLER}    gain = 2\n")
    assert inputs(cell(scenario, f"{file}:Still")) != before


def test_changed_scenario_of_the_same_name_is_refused(
    scenario: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "study"

    def go_on(*more: Cell) -> list[str]:
        cells = [cell(scenario), *more]
        with StudyStore(folder, about={}) as store:
            execute(cells, store, robot="walker", jobs=1, title="")
            return list(store.rows)

    go_on()
    other = tmp_path / "other.toml"
    other.write_text(SHORT)
    assert len(go_on(cell(other))) == 2, "a further scenario throws nothing away"
    scenario.write_text(f"{SHORT}friction = 0.5\n")
    with pytest.raises(UsageError, match="before its scenario, robot or settings"):
        go_on()


def test_run_with_other_inputs_than_the_study_is_refused(scenario: Path) -> None:
    with pytest.raises(UsageError, match="not those that the study began with"):
        Task(cell(scenario), "walker", inputs="0" * 64).run()
