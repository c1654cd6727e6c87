"""A finished run is reused as long as nothing it depends on has changed."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from surefoot.errors import UsageError
from surefoot.installation import own_sources
from surefoot.stabilizer import foreign
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
    assert [*own_sources(str(file), ["builtins"])] == [CONTROLLER.encode()]
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
    with pytest.raises(UsageError, match="before its scenario, robot, settings or"):
        go_on()


def test_run_with_other_inputs_than_the_study_is_refused(scenario: Path) -> None:
    with pytest.raises(UsageError, match="not those that the study began with"):
        Task(cell(scenario), "walker", inputs="0" * 64).run()


OWN = {
    "law/__init__.py": "from law.gains import GAIN\n",
    "law/gains.py": "import numpy\nGAIN = 1.0\n",
    "law/limits.py": "MOST = 1.0\n",
    "law/base.py": f"from .limits import MOST\nfrom . import parts\n{CONTROLLER}",
    "law/parts/__init__.py": "def late():\n    import late_part\n",
    "late_part.py": "LATE = 1.0\n",
    "hidden.py": CONTROLLER,
    "unused.py": "NOT = 1.0\n",
    "mine.py": """
from functools import partial
import importlib
import law.base

class Still(law.base.Still):
    pass

class Hidden(getattr(importlib.import_module("hid" + "den"), "Still")):
    pass

class Makes:
    def __call__(self, robot, settings):
        return Still()

make, makes = partial(Still), Makes()
""",
}


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Write modules of a user that Python finds, in this test only."""
    folder, before = tmp_path / "own", {*sys.modules}
    for name, text in OWN.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    monkeypatch.syspath_prepend(folder)
    yield folder
    for name in {*sys.modules} - before:
        if str(vars(sys.modules[name]).get("__file__")).startswith(str(folder)):
            del sys.modules[name]


@pytest.mark.parametrize("maker", ["Still", "make", "makes"])
def test_controller_counts_with_all_modules_of_the_user_that_it_imports(
    scenario: Path, own: Path, maker: str
) -> None:
    by_path, by_name = (
        cell(scenario, f"{o}:{maker}") for o in (own / "mine.py", "mine")
    )
    seen = [inputs(by_path)]
    assert inputs(by_name) == seen[0]
    importlib.import_module("late_part")
    importlib.import_module("unused")
    assert inputs(by_path) == seen[0], "what else is loaded does not count"
    for name in OWN.keys() - {"hidden.py", "unused.py"}:
        (own / name).write_text(f"{OWN[name]}\nMORE = 1\n")
        seen.append(inputs(by_path))
    assert len({*seen}) == len(seen)
    for name in ("hidden.py", "unused.py"):
        (own / name).write_text("MORE = 1\n")
    assert inputs(by_path) == seen[-1]


def test_the_module_of_a_base_class_counts_however_it_was_imported(
    scenario: Path, own: Path
) -> None:
    before = inputs(cell(scenario, "mine:Hidden"))
    (own / "hidden.py").write_text(f"{CONTROLLER}    gain = 2\n")
    assert inputs(cell(scenario, "mine:Hidden")) != before


def test_an_installed_controller_counts_with_its_own_package(
    scenario: Path, tmp_path: Path, own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed = tmp_path / "site-packages"
    own.rename(installed)
    about = installed / "mine-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        f"[{foreign.ENTRY_POINTS}]\nown-law = law.mine:make\n"
    )
    (installed / "mine.py").rename(installed / "law" / "mine.py")
    monkeypatch.syspath_prepend(installed)
    named = cell(scenario, "own-law")
    seen = [inputs(named)]
    for name in ("law/limits.py", "law/mine.py"):
        (installed / name).write_text(f"{(installed / name).read_text()}\nMORE = 1\n")
        seen.append(inputs(named))
    assert len({*seen}) == len(seen)
    (installed / "late_part.py").write_text("MORE = 1\n")
    assert inputs(named) == seen[-1]
    for name in [n for n in sys.modules if n.partition(".")[0] == "law"]:
        del sys.modules[name]
