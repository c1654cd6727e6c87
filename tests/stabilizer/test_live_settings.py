from __future__ import annotations

import pytest

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import ControllerSettings, setting_names
from surefoot.stabilizer.requests import (
    LIVE_SETTINGS,
    between,
    live_values,
    with_values,
)

DEFAULTS = ControllerSettings()


def test_every_live_setting_exists() -> None:
    assert set(LIVE_SETTINGS) <= set(setting_names())


def test_values_read_and_put_back_change_nothing() -> None:
    assert with_values(DEFAULTS, live_values(DEFAULTS)) == DEFAULTS


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"tsid.com_kpp": [1.0]}, "did you mean 'tsid.com_kp'"),
        ({"tsid.friction": [0.5]}, "cannot be changed during a run"),
        ({"tsid.com_kp": [-1.0]}, r"com_kp\[0\]"),
        ({"dik.k_force": [50.0]}, "k_force"),
        ({"tsid.com_kp": [1.0, 2.0]}, "got 2 numbers, expected 1 or 3"),
        ({"tsid.com_kp": []}, "got 0 numbers"),
        ({"tsid.base_kp": [float("nan")]}, "finite"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(
    values: dict[str, list[float]], says: str
) -> None:
    with pytest.raises(FileFormatError, match=says):
        with_values(DEFAULTS, values)


def test_the_way_between_begins_and_ends_at_its_ends() -> None:
    before, after = {"a": [1.0, 2.0]}, {"a": [3.0, -2.0]}
    assert between(before, after, share=0.0) == before
    assert between(before, after, share=1.0) == after
    assert between(before, after, share=0.25) == {"a": [1.5, 1.0]}
