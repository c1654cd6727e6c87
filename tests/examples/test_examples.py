"""Each example runs as for a new user, on scenarios of one or two seconds."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest

from tests.command import cut_short, scenario_file

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PNG = b"\x89PNG\r\n"
SHORTER = ("duration_s=2.0", "duration_s=1.2")
"""The notebook's seven runs are shortened; errors count from one second on."""
SWAY_S = 5.0
"""Longer than 4.2 s, when holding still falls."""
LEAST_BYTES = 5000
"""Bytes of a plot with axes and curves; an empty one has fewer."""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    noise = "[sensors]\nforce_noise_n = 2.0\n"
    return scenario_file(tmp_path, 1.5, name="short", more=noise)


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "Agg")


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def is_plot(path: Path) -> bool:
    data = path.read_bytes()
    return data.startswith(PNG) and len(data) > LEAST_BYTES


def test_simulate_and_plot(
    tmp_path: Path, scenario: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plot = tmp_path / "forces.png"
    load("simulate_and_plot").main(str(plot), str(scenario))
    said = capsys.readouterr().out
    assert "stood after 1.5 s" in said
    assert "1500 ticks of 1 ms" in said
    assert is_plot(plot)


def test_own_controller_stands_where_holding_falls(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plot = tmp_path / "tilt.png"
    scenario = cut_short("tilt-sine-pitch", tmp_path, SWAY_S)
    load("own_controller").main(str(plot), str(scenario))
    hold, own, whole_body = capsys.readouterr().out.splitlines()[:3]
    assert hold.strip().startswith("hold: fell")
    assert own.strip().startswith("ankle: stood")
    assert whole_body.strip().startswith("whole-body: stood")
    assert is_plot(plot)


def test_hand_task_brings_the_hand_near_its_target(
    scenario: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load("hand_task").main(str(scenario))
    stood, distance = capsys.readouterr().out.splitlines()
    assert stood == "short: stood"
    before, after = (float(word) for word in distance.split() if word[0].isdigit())
    assert after < 0.2 * before


def test_own_scenario(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plot = tmp_path / "tilt.png"
    module = load("own_scenario")
    module.main(str(plot), 1.0)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" N: ")[0] for line in lines[:-1]] == [
        f"{force:g}" for force in module.FORCES_N
    ]
    assert is_plot(plot)


@pytest.mark.usefixtures("no_screen")
def test_every_cell_of_the_notebook_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    notebook = json.loads((EXAMPLES / "tour.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert sum(SHORTER[0] in "".join(cell["source"]) for cell in cells) == 1
    names: dict[str, object] = {"__name__": "__main__"}
    for cell in cells:
        source = "".join(cell["source"]).replace(*SHORTER)
        exec(compile(source, f"tour.ipynb, cell {cell['id']}", "exec"), names)
    said = capsys.readouterr().out
    assert "28 joints" in said
    assert "stood" in said
    assert "F_meas" in said


def test_the_notebook_keeps_no_outputs() -> None:
    """Results of one machine would grow old."""
    notebook = json.loads((EXAMPLES / "tour.ipynb").read_text(encoding="utf-8"))
    for cell in notebook["cells"]:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


def test_the_page_names_every_example() -> None:
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    for path in (*EXAMPLES.glob("*.py"), *EXAMPLES.glob("*.ipynb")):
        assert f"({path.name})" in page
