"""Arguments of a sweep, and mistakes in them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from surefoot.cli.study_commands import parse_seeds, parse_vary
from surefoot.errors import UsageError
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.studies.cell import VARIANTS, Cell, Row, group_of
from surefoot.studies.study import make_cells, study
from tests.command import Surefoot


@pytest.mark.parametrize(
    ("text", "seeds"), [("0:4", [0, 1, 2, 3]), ("7", [7]), ("1,4,7", [1, 4, 7])]
)
def test_seeds_are_a_range_or_a_list(text: str, seeds: list[int]) -> None:
    assert list(parse_seeds(text)) == seeds


@pytest.mark.parametrize("text", ["", "a:b", "4:4", "-1,2", "1;2", f"0:{10**20}"])
def test_other_seeds_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--seeds"):
        parse_seeds(text)


def test_values_are_a_list_or_evenly_spaced() -> None:
    assert parse_vary("friction=0.4,0.7") == [("friction", 0.4), ("friction", 0.7)]
    spaced = [value for _, value in parse_vary("friction=0.4:1.0:4")]
    assert spaced == pytest.approx([0.4, 0.6, 0.8, 1.0])
    lists = parse_vary("sensors.gyro_bias_rad_s=[0, 0, 1e-3], [0, 2e-3, 0]")
    assert [value for _, value in lists] == [[0, 0, 1e-3], [0, 2e-3, 0]]


@pytest.mark.parametrize(
    "text", ["friction", "friction=", "friction=0:1:x", "friction=0:1:2000000"]
)
def test_other_values_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--vary"):
        parse_vary(text)


def test_every_combination_is_there_once_a_round_per_seed() -> None:
    cells = make_cells(
        ["standing", "push-standing"],
        levels=[parse_vary("friction=0.4,0.7"), parse_vary("pace=1,2,3")],
        controllers=["whole-body", "zmp-tuned"],
        robot="walker",
        servo_profiles=["ideal"],
        seeds=[3, 5],
    )
    assert len({cell.key for cell in cells}) == len(cells) == 2 * 2 * 3 * 2 * 2
    half = len(cells) // 2
    assert {cell.seed for cell in cells[:half]} == {3}


def test_a_study_that_no_one_could_run_is_refused_at_once() -> None:
    with pytest.raises(
        UsageError, match="1e\\+18 runs: expected 1 to 1000000; give fewer"
    ):
        make_cells(
            ["standing"],
            levels=[parse_vary("friction=0.4:1:1000000")],
            controllers=["whole-body"],
            robot="walker",
            servo_profiles=["ideal"],
            seeds=range(10**12),
        )


def test_unknown_controller_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(UsageError, match="zmp-stock"):
        make_cells(
            ["standing"],
            levels=[],
            controllers=["zpm"],
            robot="walker",
            servo_profiles=["ideal"],
            seeds=[0],
        )


def test_every_variant_has_settings_for_every_servo_profile() -> None:
    profiles = load_robot("walker").file.servo.profiles
    for variant in VARIANTS.values():
        assert set(variant.settings_of) <= set(profiles)
        for profile in profiles:
            assert isinstance(variant.resolve(profile), ControllerSettings)


def test_the_tuned_baseline_has_its_own_settings_for_slow_servos() -> None:
    tuned = VARIANTS["zmp-tuned"]
    assert tuned.resolve("ideal") == ControllerSettings()
    slow = tuned.resolve("harmonic", extra=("zmp.dcm_prop_gain=1.5",)).zmp
    assert slow.cop_admittance != ControllerSettings().zmp.cop_admittance
    assert slow.dcm_prop_gain == 1.5


def test_value_that_is_varied_twice_is_refused() -> None:
    with pytest.raises(UsageError, match="friction: is varied twice"):
        make_cells(
            ["standing"],
            levels=[parse_vary("friction=0.5"), parse_vary("friction=0.7")],
            controllers=["hold"],
            robot="walker",
            servo_profiles=["ideal"],
            seeds=[0],
        )


def test_a_table_is_no_value() -> None:
    with pytest.raises(UsageError, match=r"posture: got .*vary the table's keys"):
        study("standing", vary={"start.posture": [{"left_knee": 1.0}]})


def test_lists_are_values_too_and_are_shown() -> None:
    [cell] = make_cells(
        ["standing"],
        levels=[parse_vary("sensors.force_bias_n=[1,2.5,3]")],
        controllers=["hold"],
        robot="walker",
        servo_profiles=["ideal"],
        seeds=[0],
    )
    assert cell.case == "standing (sensors.force_bias_n [1, 2.5, 3])"
    plan = cell.plan(robot="walker", overrides=())
    assert plan.scenario.sensors.force_bias_n == [1.0, 2.5, 3.0]
    assert group_of(row_of(cell)) == cell.group


def row_of(cell: Cell) -> Row:
    """Return a study's row for a cell, read back from its file."""
    group = cell.group
    row = {
        "scenario": group.scenario,
        "values": dict(group.values),
        "variant": group.variant,
        "servo_profile": group.servo_profile,
    }
    read: Row = json.loads(json.dumps(row))
    return read


def test_run_that_is_asked_for_twice_does_not_count_as_two(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="asked for twice"):
        study("standing", seeds=[3, 3], controllers=["hold"], out=tmp_path / "study")
    with pytest.raises(UsageError, match="friction: 1 is named twice; name it once"):
        study("standing", vary={"friction": [1, 1.0]}, out=tmp_path / "study")
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize("address", ["nonsense", "", "foo://head:1", "head:8786"])
def test_scheduler_is_an_address(tmp_path: Path, address: str) -> None:
    with pytest.raises(UsageError, match="expected the address of a Dask scheduler"):
        study("standing", scheduler=address, out=tmp_path / "study")
    assert not (tmp_path / "study").exists()


def test_recording_that_is_missing_is_named_before_anything_is_written(
    tmp_path: Path,
) -> None:
    scenario = tmp_path / "shaken.toml"
    scenario.write_text(
        'name = "shaken"\nduration_s = 0.1\n[[platform]]\nfoot = "both"\n'
        '[[platform.motion]]\naxis = "x"\nkind = "recorded"\nfile = "none.csv"\n'
    )
    with pytest.raises(ScenarioError, match=r"shaken.toml: platform\[0\].motion\[0\]"):
        study(scenario, out=tmp_path / "study")
    assert not (tmp_path / "study").exists()


def test_report_of_runs_that_are_not_there_is_refused(
    tmp_path: Path, surefoot_here: Surefoot
) -> None:
    out = tmp_path / "r"
    done = surefoot_here("reproduce", "--quick", "--report-only", "--out", out)
    assert done.returncode == 2
    assert "holds no finished runs to report" in done.stderr
    assert not out.exists()
