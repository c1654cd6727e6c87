"""Controller settings: defaults, files, overrides, and mistakes."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import (
    ControllerSettings,
    build_settings,
    setting_names,
    setting_of,
)


def build(
    table: dict[str, Any] | None = None, overrides: list[str] | None = None
) -> ControllerSettings:
    return build_settings(table or {}, overrides=overrides or [], source="my.toml")


def test_nothing_said_gives_the_defaults() -> None:
    assert build() == ControllerSettings()


def test_every_setting_can_be_overridden_by_its_name() -> None:
    """Each with its default, written as TOML, which changes nothing."""
    defaults = ControllerSettings()
    for name in setting_names():
        value = setting_of(defaults, name)
        text = list(value) if isinstance(value, tuple) else value
        assert build(overrides=[f"{name}={text}"]) == defaults


def test_override_changes_its_setting_and_no_other() -> None:
    changed = build(overrides=["dik.base_gain = 3.5"])
    assert changed.dik.base_gain == 3.5
    back = msgspec.structs.replace(
        changed.dik, base_gain=ControllerSettings().dik.base_gain
    )
    assert msgspec.structs.replace(changed, dik=back) == ControllerSettings()


def test_override_beats_the_file_and_the_last_beats_the_first() -> None:
    table = {"tsid": {"base_kp": 1.0, "base_kd": 2.0}}
    settings = build(table, ["tsid.base_kp=3.0", "tsid.base_kp=4.0"])
    assert (settings.tsid.base_kp, settings.tsid.base_kd) == (4.0, 2.0)


def test_table_is_not_changed_by_overrides() -> None:
    table: dict[str, Any] = {"tsid": {"base_kp": 1.0}}
    build(table, ["tsid.base_kp=3.0", "dik.base_gain=1.0"])
    assert table == {"tsid": {"base_kp": 1.0}}


def test_vectors_are_written_as_toml_arrays() -> None:
    assert build(overrides=["tsid.com_kp=[1, 2.5, 3]"]).tsid.com_kp == (1.0, 2.5, 3.0)


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("tsid.com_kq=[1, 1, 1]", "tsid.com_kp"), ("dkk.base_gain=1", "dik.base_gain")],
)
def test_unknown_override_names_the_nearest(wrong: str, right: str) -> None:
    with pytest.raises(FileFormatError, match=f"did you mean '{right}'") as error:
        build(overrides=[wrong])
    assert error.value.field == wrong.split("=")[0]


@pytest.mark.parametrize(
    ("table", "right", "field"),
    [
        ({"tsid": {"com_kq": [1.0, 1.0, 1.0]}}, "com_kp", "tsid.com_kq"),
        ({"tsidd": {}}, "tsid", "tsidd"),
    ],
)
def test_unknown_key_of_a_table_names_the_nearest(
    table: dict[str, Any], right: str, field: str
) -> None:
    with pytest.raises(FileFormatError, match=rf"my\.toml.*{right}") as error:
        build(table)
    assert error.value.field == field


@pytest.mark.parametrize(
    ("override", "field"),
    [
        pytest.param("dik.base_gain=fast", "dik.base_gain", id="text"),
        pytest.param("dik.base_gain=true", "dik.base_gain", id="truth value"),
        pytest.param("tsid.com_kp=true", "tsid.com_kp", id="truth value for three"),
        pytest.param("tsid.com_kp=[30, 30]", "tsid.com_kp", id="two of three"),
        pytest.param("dik.base_gain=0", "dik.base_gain", id="not positive"),
        pytest.param("dik.base_gain=nan", "dik.base_gain", id="not a number"),
        pytest.param("dik.base_gain=inf", "dik.base_gain", id="not finite"),
        pytest.param("tsid.sole_scale=1.1", "tsid.sole_scale", id="over the range"),
    ],
)
def test_value_that_does_not_fit_names_its_setting(override: str, field: str) -> None:
    with pytest.raises(FileFormatError, match=field.replace(".", r"\.")) as error:
        build(overrides=[override])
    assert error.value.field == field


def test_one_number_stands_for_all_axes() -> None:
    settings = build(overrides=["tsid.com_kp=40", "dik.k_force=-30"])
    assert settings.tsid.com_kp == (40.0, 40.0, 40.0)
    assert settings.dik.k_force == (-30.0,) * 6


def test_positive_wrench_gain_is_refused() -> None:
    """K is negative definite, or a foot pushed too hard would push back."""
    with pytest.raises(FileFormatError, match="k_force") as error:
        build(overrides=["dik.k_force=[-25, -25, 25, -25, -25, -25]"])
    assert error.value.field == "dik.k_force[2]"


def test_override_without_a_value_shows_how_to_write_one() -> None:
    with pytest.raises(FileFormatError, match="KEY=VALUE"):
        build(overrides=["dik.base_gain"])


def test_section_that_is_no_table_is_refused() -> None:
    with pytest.raises(FileFormatError) as error:
        build({"dik": 3.0}, ["dik.base_gain=1.0"])
    assert error.value.field == "dik"


def test_paper_preset_is_the_published_law_alone() -> None:
    paper = build(overrides=["whole_body.preset=paper"])
    assert paper.ground.gain == (0.0,) * 6
    assert paper.tsid.leg_posture_weight == paper.tsid.posture_weight
    assert paper.dik.leg_posture_weight == paper.dik.posture_weight


def test_settings_beside_a_preset_win() -> None:
    table = {"whole_body": {"preset": "paper"}, "tsid": {"leg_posture_weight": 0.5}}
    paper = build(table, ["ground.gain=0.25"])
    assert paper.tsid.leg_posture_weight == 0.5
    assert paper.ground.gain == (0.25,) * 6


def test_resolved_preset_reads_back_the_same() -> None:
    paper = build(overrides=["whole_body.preset=paper", "dik.leg_posture_weight=0.2"])
    assert build(msgspec.to_builtins(paper)) == paper


def test_unknown_preset_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(FileFormatError, match=r"whole_body\.preset"):
        build(overrides=["whole_body.preset=papr"])
