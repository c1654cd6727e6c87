"""Custom controllers, everywhere a controller is named."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import surefoot as sf
from surefoot.bench.bench_runs import Under
from surefoot.bench.sway_cells import Stimulus, sway_cell
from surefoot.controllers import make_controller, name_of, settings_for
from surefoot.errors import UsageError
from surefoot.robot_io.robot import load_robot
from surefoot.run_plan import resolve_settings
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer import controller as controllers
from surefoot.stabilizer import foreign
from surefoot.stabilizer.qp import DenseQp, QpStatus
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from surefoot.studies.cell import Cell, Group, Work, find_variant
from surefoot.studies.store import Task
from surefoot.tuning.objectives import EFFORT, TuneCell
from tests.command import Surefoot, run_surefoot, scenario_file
from tests.surefoot import own_controllers as own

HERE = Path(__file__).parent
STAY = f"{HERE / 'own_controllers.py'}:Stay"
SCENARIO = sf.Scenario(name="own", duration_s=0.3)
ONE_STEP = {"start_s": 0.2, "step": [{"side": "left", "position_m": [0.1, 0.11]}]}


@pytest.fixture(scope="module")
def held() -> str:
    """Return the hash of the shipped controller that does the same."""
    run = sf.simulate("walker", SCENARIO, controller="hold")
    return run.result.log_sha256


@pytest.mark.parametrize(
    "controller",
    [
        own.Stay(),
        own.Stay,
        own.StayWithRobot,
        own.StayWithSettings,
        STAY,
        f"{HERE / 'own_controllers.py'}:StayWithRobot",
    ],
    ids=("object", "class", "with robot", "with settings", "file", "other file"),
)
def test_an_object_a_class_or_a_name_runs(controller: object, held: str) -> None:
    run = sf.simulate("walker", SCENARIO, controller=controller)
    assert run.result.log_sha256 == held


def test_a_module_of_a_package_and_an_entry_point(
    monkeypatch: pytest.MonkeyPatch, held: str
) -> None:
    class Entry:
        name = "mine"

        def load(self) -> type:
            return own.Stay

    monkeypatch.setattr(foreign, "entry_points", lambda group: [Entry()])
    for name in ("mine", "tests.surefoot.own_controllers:Stay"):
        run = sf.simulate("walker", SCENARIO, controller=name)
        assert run.result.log_sha256 == held
        assert run.result.controller == name
    assert sf.list_controllers() == ["whole-body", "zmp", "hold", "mine"]


def test_a_class_derived_from_a_shipped_one_may_do_all_that_it_may() -> None:
    walker = load_robot("walker")
    shipped = WholeBodyController(walker, ControllerSettings())
    derived = foreign.adapt(own.Derived(walker, ControllerSettings()), walker)
    assert isinstance(derived, foreign.ForeignController)
    optional = [
        kind
        for kind in vars(controllers).values()
        if inspect.isclass(kind) and getattr(kind, "_is_runtime_protocol", False)
    ]
    assert controllers.Walks in optional
    for kind in optional:  # one method each, so that none is half there
        assert len([name for name in vars(kind) if not name.startswith("_")]) == 1
        assert isinstance(shipped, kind)
        assert isinstance(derived, kind)


@pytest.mark.closed_loop
def test_a_class_derived_from_a_shipped_one_walks_the_same_walk() -> None:
    scenario = scenario_from_table(
        {"name": "walk", "duration_s": 3.0, "walk": ONE_STEP}, source="test"
    )
    runs = [
        sf.simulate("walker", scenario, controller=name).result
        for name in ("whole-body", own.Derived)
    ]
    assert runs[0].steps_done
    assert runs[0].log_sha256 == runs[1].log_sha256


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("whole-bdy", "did you mean 'whole-body'"),
        ("nowhere.py:Stay", "nowhere.py: no such file"),
        ("no_such_module:Stay", "no module 'no_such_module'"),
        (f"{HERE / 'own_controllers.py'}:Sta", "did you mean 'Stay'"),
        (f"{HERE / 'own_controllers.py'}:not_a_class", "expected a class"),
        (f"{HERE / 'own_controllers.py'}:NoStep", "has no step"),
    ],
)
def test_a_wrong_name_is_refused_in_words(name: str, told: str) -> None:
    with pytest.raises(sf.ControllerError, match=told):
        sf.simulate("walker", SCENARIO, controller=name)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("class X(:", "broken.py, line 1: invalid syntax"),
        ("1 / 0", r"ZeroDivisionError: division by zero \(broken.py, line 1\)"),
        ("raise SystemExit(3)", r"SystemExit: 3 \(broken.py, line 1\)"),
        (
            "class X:\n    def __init__(self, robot):\n        self.n = robot.joints",
            r"AttributeError: .* no attribute 'joints' \(broken.py, line 3\)",
        ),
    ],
)
def test_one_that_does_not_load_is_told_in_words(
    tmp_path: Path, text: str, told: str
) -> None:
    file = tmp_path / "broken.py"
    file.write_text(text)
    with pytest.raises(sf.ControllerError, match=f"controller {file}:X: {told}"):
        sf.simulate("walker", SCENARIO, controller=f"{file}:X")


def test_a_file_that_has_changed_is_loaded_anew(tmp_path: Path) -> None:
    """As in a notebook, whose process lives on; within a second, of the same length."""
    file = tmp_path / "edited.py"
    text = "from tests.surefoot.own_controllers import Stay\nclass X(Stay): gain = 1"
    file.write_text(text)
    before, again = (foreign.find_target(f"{file}:X") for _ in range(2))
    assert before is again
    file.write_text(text.replace("1", "2"))
    assert foreign.find_target(f"{file}:X").gain == 2


def test_a_missing_package_of_a_controller_is_named(tmp_path: Path) -> None:
    file = tmp_path / "needs.py"
    file.write_text("import no_such_package")
    with pytest.raises(ImportError, match=r"needs.py:X: .*no_such.*needs.py, line 1"):
        sf.simulate("walker", SCENARIO, controller=f"{file}:X")


@pytest.mark.parametrize("run", [sf.simulate, sf.run])
def test_what_is_no_controller_is_refused(run: Callable[..., sf.Run]) -> None:
    with pytest.raises(sf.ControllerError, match="got 3, expected a name such as"):
        run("walker", SCENARIO, controller=3)


@pytest.mark.parametrize(
    ("controller", "told"),
    [
        (own.TooShort(), r"shape \(27,\), expected \(28,\)"),
        (own.TellsTooLittle(), r"F_meas of shape \(6,\), expected \(12,\)"),
        (own.Exits(), r"SystemExit: 3 \(own_controllers.py, line \d+\)"),
    ],
)
def test_a_wrong_answer_is_refused_in_words(controller: object, told: str) -> None:
    with pytest.raises(sf.ControllerError, match=told):
        sf.simulate("walker", SCENARIO, controller=controller)


def test_an_answer_may_have_lists_and_tuples(held: str) -> None:
    run = sf.simulate("walker", SCENARIO, controller=own.Tells(), record=True)
    assert run.result.log_sha256 == held
    np.testing.assert_array_equal(run.signals["in_contact"][-1], [1, 0])
    np.testing.assert_array_equal(run.signals["F_id"][-1], 0.0)


def test_a_reference_may_be_taken_by_keyword() -> None:
    inner = own.ByKeyword()
    adapted = foreign.adapt(inner, load_robot("walker"))
    first = sf.Simulation("walker", SCENARIO).snapshot
    adapted.start(first, load_robot("walker").nominal)
    reference: Any = object()
    adapted.step(first, reference)
    assert inner.heard is reference


def test_a_parameter_with_a_default_is_the_makers_own() -> None:
    made = make_controller(f"{HERE / 'own_controllers.py'}:OfItsOwn")
    assert isinstance(made, foreign.ForeignController)
    assert made.inner.gain == 3.0


def test_what_a_function_makes_has_the_name_it_was_asked_for_by() -> None:
    name = f"{HERE / 'own_controllers.py'}:with_name"
    assert make_controller(name).name == name


def test_a_failed_qp_of_a_derived_class_is_kept() -> None:
    derived = own.Derived(load_robot("walker"), ControllerSettings())
    adapted = foreign.adapt(derived, load_robot("walker"))
    assert adapted.failure is None
    qp = DenseQp("wrenches", n=2, m=1)
    derived.failure = qp.data(QpStatus.NOT_FINITE)
    assert adapted.failure is derived.failure


def test_a_controller_is_started_once() -> None:
    controller = own.with_name(load_robot("walker"))
    sf.simulate("walker", SCENARIO, controller=controller)
    with pytest.raises(sf.ControllerError, match="expected a new one for each start"):
        sf.simulate("walker", SCENARIO, controller=controller)


def test_one_that_answers_no_numbers_is_given_up_the_same_way_on_the_bus(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    scenario = scenario_file(tmp_path, 0.6, name="own")
    words = (scenario, "--json", "--controller", STAY.replace("Stay", "Fails"))
    told = []
    for done in (surefoot_here("run", *words, "--inline"), run_surefoot("run", *words)):
        assert done.returncode == 1, done.stderr
        result = json.loads(done.stdout)
        assert (result["outcome"], result["end"]) == ("held", "controller_failed")
        assert "answered 28 of 28 joint positions" in result["end_detail"]
        # On the bus a command may come after the request to hold that followed it.
        assert result["refused"].pop("mode", 0) <= 1
        assert result["refused"] == {"not_finite": 10}
        told.append((result["outcome_detail"], result["log_sha256"]))
    assert told[0] == told[1]


@pytest.mark.usual("Raises")
@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("Raises", r"ValueError: boom \(own_controllers.py, line \d+\)"),
        (
            "RaisesAtStart",
            r"LookupError: no such gain \(own_controllers.py, line \d+\)",
        ),
        ("TooShort", r"step returned shape \(27,\), expected \(28,\)"),
    ],
    ids=["Raises", "RaisesAtStart", "TooShort"],
)
def test_one_that_raises_is_given_up_the_same_way_on_the_bus(
    tmp_path: Path, surefoot_here: Surefoot, kind: str, told: str
) -> None:
    scenario = scenario_file(tmp_path, 0.6, name="own")
    words = (scenario, "--json", "--controller", STAY.replace("Stay", kind))
    inline, bus = tmp_path / "inline", tmp_path / "bus"
    here = surefoot_here("run", *words, "--inline", "--out", inline)
    there = run_surefoot("run", *words, "--out", bus)
    details = []
    for done, folder in ((here, inline), (there, bus)):
        assert done.returncode == 1, done.stderr
        result = json.loads((folder / "result.json").read_text())
        assert json.loads(done.stdout)["outcome_detail"] == result["outcome_detail"]
        assert (result["outcome"], result["end"]) == ("held", "controller_failed")
        assert re.search(told, result["outcome_detail"]), result["outcome_detail"]
        details.append((result["outcome_detail"], result["log_sha256"]))
    assert details[0] == details[1]
    for text in (here.stderr, (bus / "stabilizer.log").read_text()):
        assert "Traceback" in text
        assert "own_controllers.py" in text or kind == "TooShort"
    with pytest.raises((ValueError, LookupError)):
        sf.simulate("walker", SCENARIO, controller=getattr(own, kind))


@pytest.mark.parametrize("kind", ["Raises", "RaisesAtStart"])
def test_one_that_raises_ends_no_study_no_search_and_no_benchmark(kind: str) -> None:
    name = STAY.replace("Stay", kind)
    group = Group("standing", (("duration_s", 0.6),), name, "ideal")
    tilt = sway_cell(Stimulus("prts", "pitch", 1.0), Under(name, "ideal"), height_m=1.0)
    short = msgspec.structs.replace(tilt.scenario, duration_s=0.6)
    works: list[Work] = [
        Cell(group, 0),
        TuneCell(group, 0, extra=(EFFORT,)),
        replace(tilt, scenario=short),
    ]
    for work in works:
        row = Task(work, "walker").run()
        assert row["outcome"] == "held"
        assert re.search(r"(boom|gain) \(own_controllers.py", row["outcome_detail"])


def test_the_command_line_takes_it_everywhere(
    tmp_path: Path, held: str, surefoot_here: Surefoot
) -> None:
    scenario, out = scenario_file(tmp_path, 0.3, name="own"), tmp_path / "run"
    inline = surefoot_here("run", scenario, "--inline", "--json", "--controller", STAY)
    assert json.loads(inline.stdout)["log_sha256"] == held
    bus = run_surefoot("run", scenario, "--json", "--controller", STAY, "--out", out)
    assert bus.returncode == 0, bus.stderr
    assert json.loads(bus.stdout)["log_sha256"] == held
    replayed = surefoot_here("replay", "--controller", out / "run.mcap", "--json")
    assert json.loads(replayed.stdout)["is_equal"], replayed.stderr
    law = surefoot_here(
        "replay", "--controller", out / "run.mcap", "--law", STAY, "--json"
    )
    assert json.loads(law.stdout)["is_equal"], law.stderr
    sweep = surefoot_here(
        *("sweep", scenario, "--controllers", f"hold,{STAY}", "--seeds", "0:1"),
        *("--out", tmp_path / "sweep", "--jobs", "1", "--json"),
    )
    assert sweep.returncode == 0, sweep.stderr
    assert {row["controller"] for row in json.loads(sweep.stdout)} == {"hold", STAY}
    wrong = surefoot_here("run", scenario, "--inline", "--controller", f"{STAY}s")
    assert wrong.returncode == 2
    assert "did you mean 'Stay'" in wrong.stderr


def make_stay(robot: sf.Robot, settings: ControllerSettings) -> own.Stay:
    return own.Stay()


class Makes:
    """Makes a controller when it is called."""

    def __call__(self, robot: sf.Robot) -> own.Stay:
        return own.Stay()


class Named(own.Stay):
    """Is told its name."""

    def __init__(self, name: str) -> None:
        self.name = name


class Nameless(own.StayWithRobot):
    """Inherits the name of another."""


def test_a_name_of_a_study_that_an_installed_controller_bears_too_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Entry:
        def __init__(self, name: str) -> None:
            self.name = name

    entries = [Entry(name) for name in ("whole-body", "person", "mine")]
    monkeypatch.setattr(foreign, "entry_points", lambda group: entries)
    assert find_variant("whole-body").controller == "whole-body"
    with pytest.raises(UsageError, match="'person': surefoot and an installed package"):
        find_variant("person")


@pytest.mark.parametrize(
    ("controller", "name"),
    [
        (own.Stay, "Stay"),
        (own.StayWithRobot, "stay"),
        (Nameless, "Nameless"),
        (make_stay, "make_stay"),
        (partial(partial(make_stay), settings=None), "make_stay"),
        (Makes(), "Makes"),
        (Named("told"), "told"),
        (Named, "Named"),
        (WholeBodyController, "whole-body"),
        (own.Derived, "Derived"),
        ("hold", "hold"),
    ],
)
def test_a_controller_has_its_own_name_in_results(
    controller: object, name: str
) -> None:
    assert name_of(controller) == name


def test_a_run_of_an_object_is_loaded_again(tmp_path: Path) -> None:
    run = sf.simulate("walker", SCENARIO, controller=Nameless)
    run.save(tmp_path / "run")
    again = sf.load_run(tmp_path / "run")
    assert again.result.controller == again.plan.controller == "Nameless"
    assert np.array_equal(again.signals["q"], run.signals["q"])


FOR_THE_LAW = {"tsid.com_kp": 35.0}


@pytest.mark.parametrize("form", ["single", "table", "resolved", "file"])
@pytest.mark.parametrize("controller", [own.Stay(), own.StayWithRobot, Makes()])
def test_a_setting_that_an_object_does_not_get_is_refused(
    tmp_path: Path, form: str, controller: object
) -> None:
    file = tmp_path / "settings.toml"
    file.write_text("[tsid]\ncom_kp = 35.0\n[safety]\nrecover_s = 0.2\n")
    settings: Any = {
        "single": FOR_THE_LAW,
        "table": {"tsid": {"com_kp": 35.0}},
        "resolved": resolve_settings(FOR_THE_LAW),
        "file": file,
    }[form]
    with pytest.raises(UsageError, match=r"tsid\.com_kp: \w+ would not get it"):
        sf.simulate("walker", SCENARIO, controller=controller, settings=settings)
    assert settings_for(own.StayWithSettings, settings).tsid.com_kp[0] == 35.0
    file.write_text("[estimator]\ncalibration_s = 0.2\n[walk]\nshift_s = 0.9\n")
    assert settings_for(controller, file).estimator.calibration_s == 0.2


@pytest.mark.parametrize("make", [sf.simulate, sf.run])
def test_a_setting_in_a_table_that_nothing_reads_is_refused(
    make: Callable[..., sf.Run],
) -> None:
    table = {"tsid": {"com_kp": 35.0}}
    with pytest.raises(FileFormatError, match="hold would not read it"):
        make("walker", SCENARIO, controller="hold", settings=table)
    with pytest.raises(FileFormatError, match="hold would not read it"):
        sf.make_controller("hold", settings=table)


@pytest.mark.parametrize(
    "name", ["whole-body", "tests.surefoot.own_controllers:Derived"]
)
def test_an_object_made_for_another_servo_profile_is_refused(name: str) -> None:
    law = sf.make_controller(name)
    with pytest.raises(UsageError, match=r"'ideal', expected one .* 'harmonic'"):
        sf.simulate("walker", SCENARIO, controller=law, servo_profile="harmonic")


def test_an_answer_is_not_kept_by_the_library() -> None:
    """A controller may reuse its array for the next answer."""
    controller = own.Stay()
    run = sf.Simulation("walker", SCENARIO)
    output = run.step(controller)
    assert output is not None
    assert np.shares_memory(output.q_command, controller.q)
