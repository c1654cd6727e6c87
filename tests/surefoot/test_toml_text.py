from __future__ import annotations

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from surefoot.run_plan import settings_text
from surefoot.schemas.settings import ControllerSettings, build_settings
from surefoot.schemas.toml_file import toml_text

_SCALARS = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=20)
)
_NAMES = st.from_regex(r"[a-z][a-z_0-9]{0,8}", fullmatch=True)
_TABLES = st.dictionaries(_NAMES, _SCALARS | st.lists(_SCALARS, max_size=4), max_size=4)


@given(st.dictionaries(_NAMES, _TABLES, max_size=4))
def test_tables_read_back_as_written(tables: dict[str, dict[str, object]]) -> None:
    assert tomllib.loads(toml_text(tables)) == tables


def test_settings_read_back_as_resolved() -> None:
    resolved = build_settings({}, overrides=["tsid.base_kp=123.25"])
    assert resolved != ControllerSettings()
    table = tomllib.loads(settings_text(resolved))
    assert build_settings(table, overrides=[]) == resolved
