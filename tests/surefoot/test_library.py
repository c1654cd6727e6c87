"""The Python library gives the same runs as the command line."""

from __future__ import annotations

import inspect
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import surefoot as sf
from surefoot.controllers import idle_notice, notices, walk_notice
from surefoot.robot_io.robot import make_robot
from surefoot.run_plan import check_on_disk, make_plan
from surefoot.schemas.scenario import scenario_from_table
from surefoot.schemas.toml_file import struct_table, toml_text
from tests.command import Surefoot
from tests.support import ROLLING, with_speeds


@pytest.fixture(scope="module")
def run() -> sf.Run:
    return sf.simulate("walker", ROLLING, seed=3)


def test_step_by_step_is_the_same_run(run: sf.Run) -> None:
    sim = sf.Simulation("walker", ROLLING, seed=3)
    controller = sf.make_controller("whole-body", sim.robot)
    answers = []
    while not sim.finished:
        output = sim.step(controller)
        assert output is not None
        answers.append(output.q_command.copy())
    assert sim.result().log_sha256 == run.result.log_sha256
    assert len(answers) == sim.tick == run.result.ticks == 500


def test_the_command_line_runs_the_same(
    run: sf.Run, tmp_path: Path, surefoot: Surefoot
) -> None:
    file = tmp_path / "short roll.toml"
    file.write_text(toml_text(struct_table(ROLLING)), encoding="utf-8")
    done = surefoot("run", file, "--inline", "--json", "--seed", 3)
    told = json.loads(done.stdout)
    assert told["log_sha256"] == run.result.log_sha256
    assert told["scenario"] == run.result.scenario == "short roll"


def test_the_bus_runs_the_same_and_keeps_it(run: sf.Run, tmp_path: Path) -> None:
    out = tmp_path / "kept"
    on_bus = sf.run("walker", ROLLING, seed=3, out=out)
    assert on_bus.result.log_sha256 == run.result.log_sha256
    loaded = sf.load_run(out)
    assert loaded.result == on_bus.result
    assert loaded.scenario == ROLLING
    assert loaded.plan.settings == on_bus.plan.settings
    outcome = sf.replay(out)
    assert outcome.is_equal
    assert outcome.compared >= 499  # the last answer may come after the end


def test_a_notebook_shows_a_run_and_its_robot_in_a_line(run: sf.Run) -> None:
    assert repr(run.robot) == "<Robot walker: 28 joints, 1000 Hz, ideal>"
    assert repr(run).startswith(f"<Run of {ROLLING.name}: walker, whole-body, seed 3; ")
    assert f"{run.outcome} 0.5 s" in repr(run)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"seed": -1}, "seed: got -1, expected a whole number, 0 or more"),
        ({"seed": 1.5}, "seed: got 1.5, expected"),
        ({"scenario": {"name": "x"}}, "scenario: got a dict, expected a name"),
    ],
)
def test_what_is_no_seed_and_no_scenario_is_told(given: Any, told: str) -> None:
    with pytest.raises(sf.UsageError, match=re.escape(told)):
        sf.simulate("walker", **{"scenario": ROLLING, **given})


def test_a_study_of_no_seed_is_refused() -> None:
    with pytest.raises(sf.UsageError, match="0 runs: expected 1 to"):
        sf.study("standing", seeds=[])


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"scenarios": [ROLLING]}, "scenario: got a Scenario, expected a name or a"),
        ({"scenarios": ROLLING}, "scenario: got a Scenario, expected a name or a"),
        ({"controllers": [sf.Controller]}, "controller: got Controller, expected a na"),
        ({"robot": {}}, "robot: got a dict, expected a name or a path"),
    ],
)
def test_a_study_tells_what_its_processes_cannot_load(given: Any, told: str) -> None:
    with pytest.raises(sf.UsageError, match=re.escape(told)):
        sf.study(**{"scenarios": "standing", **given})


def test_a_study_of_a_loaded_robot_has_its_servo_profile(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    file.write_text('name = "s"\nduration_s = 0.01\n', encoding="utf-8")
    robot = sf.load_robot("walker", servo_profile="harmonic")
    study = sf.study(file, robot=robot, controllers="hold", jobs=1)
    assert [row["servo_profile"] for row in study.rows] == ["harmonic"]


def test_a_study_has_the_servo_profile_of_the_robot_file(tmp_path: Path) -> None:
    scenario, robot = tmp_path / "s.toml", tmp_path / "mine.toml"
    scenario.write_text('name = "s"\nduration_s = 0.01\n', encoding="utf-8")
    robot.write_text('extends = "walker"\nservo.profile = "harmonic"\n', "utf-8")
    study = sf.study(scenario, robot=robot, controllers=["hold"], jobs=1)
    own = sf.simulate(robot, scenario, controller="hold")
    assert [row["log_sha256"] for row in study.rows] == [own.result.log_sha256]
    assert "harmonic" in study.table()


def test_a_loaded_robot_takes_another_servo_profile_and_stays_what_it_is() -> None:
    walker = sf.load_robot("walker", servo_profile="ideal")
    file = msgspec.structs.replace(walker.file, rate_hz=500.0)
    robot = make_robot(file, path=walker.path, urdf_path=walker.urdf_path)
    found = sf.compute_margins(robot, servo_profile="harmonic")
    assert (found.servo_profile, found.rate_hz) == ("harmonic", 500.0)
    plan = make_plan(ROLLING, robot=robot, servo_profile="harmonic")
    assert plan.robot.file.rate_hz == 500.0


def _changed_walker() -> sf.Robot:
    walker = sf.load_robot("walker")
    slow = msgspec.structs.replace(walker.servo_profile, lag_s=0.01)
    servo = msgspec.structs.replace(walker.file.servo, profiles={"ideal": slow})
    file = msgspec.structs.replace(walker.file, servo=servo)
    return make_robot(file, path=walker.path, urdf_path=walker.urdf_path)


def test_a_robot_that_its_file_does_not_hold_is_refused_where_the_file_is_read(
    tmp_path: Path,
) -> None:
    told, out = r"walker\.toml holds .* \(differing: servo\)", tmp_path / "out"
    robot, short = _changed_walker(), msgspec.structs.replace(ROLLING, duration_s=0.02)
    with pytest.raises(sf.UsageError, match=told):
        sf.run(robot, short, out=out)
    with pytest.raises(sf.UsageError, match=told):
        sf.study("standing", robot=robot)
    run = sf.simulate(robot, short)
    with pytest.raises(sf.UsageError, match=told):
        run.save(out)
    assert not out.exists()
    file = tmp_path / "slow.toml"
    file.write_text(
        'extends = "walker"\n[servo.profiles.ideal]\nlag_s = 0.01\n'
        f"velocity_limit_rad_s = {robot.servo_profile.velocity_limit_rad_s}\n",
        encoding="utf-8",
    )
    written = sf.load_robot(file)
    kept = sf.simulate(written, short).save(out)
    assert kept.result.log_sha256 == run.result.log_sha256
    file.unlink()
    with pytest.raises(sf.UsageError, match=r"gives none: .*slow\.toml"):
        sf.simulate(written, short).save(out, overwrite=True)
    assert (out / "result.json").is_file()  # the former run is still there


@pytest.mark.parametrize("profile", ["ideal", "harmonic"])
def test_a_loaded_robot_is_what_its_file_holds(profile: str) -> None:
    check_on_disk(sf.load_robot("walker", servo_profile=profile))


def test_settings_may_be_a_table_of_names(run: sf.Run) -> None:
    same = sf.simulate("walker", ROLLING, seed=3, settings={"tsid.com_kp": 40.0})
    other = sf.simulate("walker", ROLLING, seed=3, settings={"tsid.base_kp": 500.0})
    assert same.plan.settings.tsid.com_kp == (40.0, 40.0, 40.0)
    assert other.result.log_sha256 != run.result.log_sha256
    with pytest.raises(sf.FileFormatError, match="did you mean 'com_kp'"):
        sf.simulate("walker", ROLLING, settings={"tsid.comkp": 40.0})


def test_numbers_of_numpy_are_numbers_and_arrays_lists(tmp_path: Path) -> None:
    def push(duration_s: Any, force_n: Any) -> sf.Push:
        return sf.Push(
            body="torso", start_s=0.0, duration_s=duration_s, force_n=force_n
        )

    given = sf.Scenario(
        name="n",
        duration_s=np.float64(0.01),
        friction=np.float32(0.5),
        push=[push(np.float64(0.005), np.array([1, 2.5, 3]))],
    )
    same = sf.Scenario(
        name="n", duration_s=0.01, friction=0.5, push=[push(0.005, [1.0, 2.5, 3.0])]
    )
    names = {"tsid.base_kp": np.float64(90), "tsid.com_kp": np.array([9, 8, 7])}
    plan = make_plan(given, settings=names)
    assert plan.scenario == make_plan(same).scenario
    expected = make_plan(same, settings={k: v.tolist() for k, v in names.items()})
    assert plan.settings == expected.settings
    tsid = msgspec.structs.replace(sf.ControllerSettings().tsid, com_kp=np.full(3, 30))
    built = make_plan(given, settings=sf.ControllerSettings(tsid=tsid)).settings
    assert built.tsid.com_kp == (30.0, 30.0, 30.0)
    file = tmp_path / "s.toml"
    file.write_text(toml_text(struct_table(given)), encoding="utf-8")
    study = sf.study(
        file,
        vary={"friction": np.linspace(0.4, 0.5, 2), "tsid.base_kp": np.arange(90, 91)},
        settings={"tsid.com_kp": np.array([9, 8, 7])},
        seeds=np.arange(np.int64(3), 4),
        jobs=1,
    )
    assert [row["values"]["friction"] for row in study.rows] == [0.4, 0.5]
    again = sf.simulate("walker", given, settings=names, seed=3)
    assert study.rows[1]["log_sha256"] == again.result.log_sha256
    with pytest.raises(sf.FileFormatError, match=r"got <object .* expected numbers"):
        make_plan(sf.Scenario(name="n", duration_s=object()))  # type: ignore[arg-type]


def test_another_controller_takes_over_where_the_robot_is() -> None:
    sim = sf.Simulation("walker", "standing", seed=0)
    first, second = (sf.make_controller("hold", sim.robot) for _ in range(2))
    for controller in (first, second):
        for _ in range(20):
            sim.step(controller)
    assert not sim.fell
    assert sim.gate.refused == {}


@pytest.mark.parametrize("name", sf.list_scenarios())
def test_a_scenario_reads_back_as_it_was_written(name: str, tmp_path: Path) -> None:
    scenario = sf.load_scenario(name)
    file = tmp_path / "again.toml"
    file.write_text(toml_text(struct_table(scenario)), encoding="utf-8")
    assert sf.load_scenario(file) == scenario


def test_a_scenario_built_in_python_is_held_to_what_a_file_must_be() -> None:
    wrong = sf.Scenario(name="x", duration_s=-1.0)
    with pytest.raises(sf.FileFormatError, match="duration_s"):
        sf.Simulation("walker", wrong)


def test_a_study_gives_the_rows_of_its_runs(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    file.write_text(toml_text(struct_table(ROLLING)), encoding="utf-8")
    study = sf.study(
        str(file), vary={"friction": [0.5, 0.7]}, seeds=[3], jobs=1, out=tmp_path / "o"
    )
    hashes = {row["values"]["friction"]: row["log_sha256"] for row in study.rows}
    assert hashes[0.7] == sf.simulate("walker", ROLLING, seed=3).result.log_sha256
    assert "friction" in study.table()
    assert (tmp_path / "o" / "summary.csv").is_file()


@pytest.mark.parametrize("name", sf.__all__)
def test_every_path_may_be_a_text(name: str) -> None:
    value = getattr(sf, name)
    if not inspect.isfunction(value):
        return
    for parameter in inspect.signature(value).parameters.values():
        kinds = str(parameter.annotation).split(" | ")
        assert ("Path" in kinds) <= ("str" in kinds), parameter


def test_every_public_name_is_there_and_documented() -> None:
    for name in sf.__all__:
        assert getattr(sf, name).__doc__, name
    assert set(sf.__all__) <= set(dir(sf))
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = sf.simulat  # type: ignore[attr-defined]


QUICK = """
import sys
from dataclasses import replace
import surefoot
heavy = {"mujoco", "pinocchio", "zenoh", "numpy", "typer", "rich", "matplotlib"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
"""
A_RUN = """
import sys
from dataclasses import replace
import surefoot as sf
import surefoot.sim_robot.robot_loop
import surefoot.stabilizer.node
sf.simulate("walker", sf.Scenario(name="x", duration_s=0.01))
rarely = {"signal", "stats", "optimize", "interpolate", "integrate", "spatial"}
loaded = {name for name in rarely if f"scipy.{name}" in sys.modules}
assert not loaded, loaded
"""
NO_EXTRAS = """
import sys
from dataclasses import replace
for name in ("matplotlib", "jinja2", "viser", "yourdfpy", "plotly", "pyarrow"):
    sys.modules[name] = None
import surefoot as sf
[getattr(sf, name) for name in sf.__all__]
scenario = sf.Scenario(name="x", duration_s=0.01)
assert sf.simulate("walker", scenario).result.ticks == 10
assert "typer" not in sys.modules
assert "rich" not in sys.modules
bare = {"schemas", "robot_io", "stabilizer", "sim_robot", "cli"} & set(sys.modules)
assert not bare, bare
"""


@pytest.mark.parametrize(
    "code", [QUICK, A_RUN, NO_EXTRAS], ids=["quick", "a run", "no extras"]
)
def test_importing_loads_no_more_than_is_used(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True)


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    sf.simulate("walker", sf.Scenario(name="x", duration_s=0.01))
    assert capfd.readouterr() == ("", "")


def test_a_run_of_another_rate_of_ticks_tells_so() -> None:
    told: list[int] = []
    sf.simulate("walker", sf.Scenario(name="x", duration_s=0.01), on_tick=told.append)
    np.testing.assert_array_equal(told, np.arange(1, 11))


@pytest.mark.parametrize(
    ("walk", "said"),
    [
        ({"velocity_m_s": 0.2}, ""),
        ({"lateral_m_s": 0.15}, "no step will be taken: step 0, left foot: 0.460 m"),
        ({"velocity_m_s": 0.2, "start_s": 9.0}, "no time for one in the 10 s"),
        ({"velocity_m_s": 0.2, "stop_s": 9.9}, "its steps (9) take until 11.2 s"),
        ({"step": [{"side": "left", "position_m": [0.2, 0.11], "step_s": 9.0}]}, "21"),
    ],
)
def test_what_of_a_walk_will_not_be_walked_is_told_beforehand(
    walk: dict[str, object], said: str
) -> None:
    scenario = scenario_from_table(
        {"name": "walk", "duration_s": 10.0, "walk": walk}, source="test"
    )
    found = walk_notice(make_plan(scenario))
    assert said in found if said else not found
    held = walk_notice(make_plan(scenario, controller="hold"))
    assert held == "no step will be taken: hold has no follow_plan(plan)"


def test_legs_slower_than_the_steps_asked_for_are_told_beforehand() -> None:
    quick = {"velocity_m_s": 0.12, "yaw_rate_deg_s": 17.2}
    scenario = scenario_from_table(
        {"name": "walk", "duration_s": 20.0, "walk": quick}, source="test"
    )
    plan = make_plan(scenario)
    assert not walk_notice(plan)
    slow = replace(plan, robot=with_speeds(plan.robot, 0.32, only="hip_yaw"))
    assert "the legs need 2." in walk_notice(slow)
    own = replace(slow, controller="tests.surefoot.own_controllers:Derived")
    assert walk_notice(own) == walk_notice(slow)


def test_what_of_a_scenario_begins_after_its_end_is_told_beforehand() -> None:
    sine = {"axis": "x", "kind": "sine", "amplitude_m": 0.1, "frequency_hz": 1.0}
    late = {"start_s": 2.0}
    table = {
        "name": "late",
        "duration_s": 2.0,
        "platform": [{"foot": "both", "motion": [sine, sine | late]}],
        "push": [{"force_n": [1.0, 0.0, 0.0]} | late],
        "rod": [
            {"kind": "force", "body": "torso", "frequency_hz": 1.0, "amplitude_n": 1.0}
            | late
        ],
        "payload": [{"link": "torso", "mass_kg": 1.0} | late],
        "fault": [{"sensor": "imu", "kind": "drop", "duration_s": 1.0} | late],
    }
    said = idle_notice(make_plan(scenario_from_table(table, source="test")))
    for name in ("platform[0].motion[1]", "push[0]", "rod[0]", "payload[0]"):
        assert f"{name} (2 s)" in said
    assert "fault[0] (2 s)" in said
    assert "motion[0]" not in said.replace("platform[0].motion[1]", "")
    longer = scenario_from_table(table | {"duration_s": 2.1}, source="test")
    assert not idle_notice(make_plan(longer))


def test_a_lag_that_cannot_be_scaled_is_told_beforehand() -> None:
    table = {"name": "x", "duration_s": 2.0, "model_error": {"servo_lag_scale": 1.3}}
    scenario = scenario_from_table(table, source="test")
    (said,) = notices(make_plan(scenario))
    assert said == (
        "servo_lag_scale = 1.3 changes nothing: servo profile 'ideal' has no lag; "
        "--servo-profile harmonic has"
    )
    assert not notices(make_plan(scenario, servo_profile="harmonic"))
