"""What a sweep is asked, and mistakes in it."""

from __future__ import annotations

import pytest

from surefoot.cli.study_commands import all_cells, parse_seeds, parse_vary
from surefoot.errors import UsageError
from surefoot.robot_io.robot import load_robot
from surefoot.schemas.settings import ControllerSettings
from surefoot.studies.cell import VARIANTS


@pytest.mark.parametrize(
    ("text", "seeds"), [("0:4", [0, 1, 2, 3]), ("7", [7]), ("1,4,7", [1, 4, 7])]
)
def test_seeds_are_a_range_or_a_list(text: str, seeds: list[int]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a:b", "4:4", "-1,2", "1;2"])
def test_other_seeds_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--seeds"):
        parse_seeds(text)


def test_values_are_a_list_or_evenly_spaced() -> None:
    assert parse_vary("friction=0.4,0.7") == [("friction", 0.4), ("friction", 0.7)]
    spaced = [value for _, value in parse_vary("friction=0.4:1.0:4")]
    assert spaced == pytest.approx([0.4, 0.6, 0.8, 1.0])


@pytest.mark.parametrize("text", ["friction", "friction=", "friction=0:1:x"])
def test_other_values_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--vary"):
        parse_vary(text)


def test_every_combination_is_there_once_a_round_per_seed() -> None:
    cells = all_cells(
        ["standing", "push-standing"],
        vary=["friction=0.4,0.7", "pace=1,2,3"],
        variants=["whole-body", "zmp-tuned"],
        servo_profiles=["ideal"],
        seeds=[3, 5],
    )
    assert len({cell.key for cell in cells}) == len(cells) == 2 * 2 * 3 * 2 * 2
    half = len(cells) // 2
    assert {cell.seed for cell in cells[:half]} == {3}


def test_unknown_controller_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(UsageError, match="zmp-stock"):
        all_cells(
            ["standing"], vary=[], variants=["zpm"], servo_profiles=["ideal"], seeds=[0]
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
