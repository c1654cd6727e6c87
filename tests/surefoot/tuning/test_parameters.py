"""Ranges and units are those of the settings' own annotations."""

from __future__ import annotations

import msgspec
import pytest

from surefoot.errors import UsageError
from surefoot.run_plan import resolve_settings
from surefoot.schemas.settings import ControllerSettings, setting_names
from surefoot.tuning.parameters import (
    Parameter,
    overrides_of,
    parse_parameter,
    unit_of,
)

START = ControllerSettings()


def test_range_choice_and_axis_are_read() -> None:
    whole = parse_parameter("tsid.com_kp=10:80", start=START)
    assert (whole.low, whole.high, whole.unit) == (10.0, 80.0, "1/s^2")
    one = parse_parameter("dik.k_force.roll=-200:-20", start=START)
    assert (one.name, one.axis, one.unit) == ("dik.k_force.roll", 3, "1/s")
    choice = parse_parameter("zmp.dcm_bias=off,filter", start=START)
    assert choice.choices == ["off", "filter"]
    assert parse_parameter("zmp.level_base=0,1", start=START).choices == [0.0, 1.0]


def test_whole_numbers_are_tried_one_by_one() -> None:
    steps = parse_parameter("walk.preview_steps=2:4", start=START)
    assert steps.choices == [2, 3, 4]
    kept = msgspec.json.decode(msgspec.json.encode(steps), type=Parameter)
    [text] = overrides_of([kept], {kept.name: kept.choices[1]}, start=START)
    assert resolve_settings(None, overrides=[text]).walk.preview_steps == 3


def test_range_is_as_far_as_the_setting_allows_or_a_factor() -> None:
    bounded = parse_parameter("ground.gain.z", start=START)
    assert (bounded.low, bounded.high) == (0.0, 1.0)
    open_ended = parse_parameter("tsid.base_kp", start=START)
    assert (open_ended.low, open_ended.high) == (25.0, 400.0)
    assert open_ended.is_log
    assert not bounded.is_log


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tsid.comkp=1:2", "did you mean 'tsid.com_kp'"),
        ("tsid.com_kp=-1:2", "got -1, expected more than 0"),
        ("dik.k_force=-20:20", "got 20, expected less than 0"),
        ("zmp.cop_admittance=0.01:0.5", "expected at most 0.1"),
        ("tsid.com_kp=80:10", "LOW below HIGH"),
        ("tsid.com_kp=a:2", "got 'a'"),
        ("tsid.com_kp=1:2:3", "got '2:3'"),
        ("tsid.com_kp.roll=1:2", "has x, y, z"),
        ("tsid.com_kp.up=1:2", "expected an axis"),
        ("tsid.base_kp.x=1:2", "has no axes"),
        ("zmp.dcm_bias=foo", "expected some of"),
        ("ground.gain", "name an axis"),
        ("walk.preview_steps", "say which to try"),
        ("walk.preview_steps=1,2.5", "expected whole numbers"),
        ("walk.preview_steps=0:3", "got 0, expected at least 1"),
        ("dik.base_gain=1,1", "names a value twice"),
    ],
)
def test_what_a_setting_does_not_allow_is_refused(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        parse_parameter(text, start=START)


def test_start_out_of_the_range_is_refused() -> None:
    with pytest.raises(UsageError, match=r"is 30\.0 to begin with"):
        parse_parameter("tsid.com_kp=40:80", start=START).check_start(START)


def test_values_that_the_user_gave_are_used_to_the_last_digit() -> None:
    one = parse_parameter("tsid.com_kp=10.00001:40", start=START)
    assert one.used(33.33333, start=30.0) == 33.33
    assert one.used(33.33333, start=33.33333) == 33.33333
    assert one.used(10.00002, start=30.0) == one.low
    choice = parse_parameter("tsid.com_kp=30,33.33333", start=START)
    assert choice.used(33.33333, start=30.0) == 33.33333


def test_values_of_axes_leave_the_others_as_they_are() -> None:
    texts = ("dik.k_force.z=-200:-20", "dik.k_force.yaw=-200:-20", "tsid.com_kp=10:80")
    parameters = [parse_parameter(text, start=START) for text in texts]
    values = {"dik.k_force.z": -30.0, "dik.k_force.yaw": -40.0, "tsid.com_kp": 20.0}
    settings = resolve_settings(
        None, overrides=overrides_of(parameters, values, start=START)
    )
    before = START.dik.k_force
    assert settings.dik.k_force == (*before[:2], -30.0, *before[3:5], -40.0)
    assert settings.tsid.com_kp == (20.0, 20.0, 20.0)
    assert [p.present(settings) for p in parameters] == [-30.0, -40.0, 20.0]


def test_every_number_with_a_unit_in_its_name_or_words_has_it() -> None:
    units = {name: unit_of(name) for name in setting_names()}
    assert units["zmp.cop_admittance"] == "rad/s per N m"
    assert units["dik.yield_limit_m_s"] == "m/s"
    assert units["contact.lost_below_n"] == "N"
    assert units["tsid.base_weight"] == ""
