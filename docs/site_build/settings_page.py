"""Reference of every controller setting, from the structs that hold them."""

from __future__ import annotations

from dataclasses import replace

import msgspec

from docs.site_build.struct_table import (
    FieldRow,
    field_rows,
    first_line,
    literals,
    table,
    value_words,
)
from surefoot.schemas.settings import PRESETS, ControllerSettings
from surefoot.stabilizer.requests import LIVE_SETTINGS

_HEAD = """# Settings

Every gain, weight and limit of the controllers, written from the structs in
[`schemas/settings.py`](../../schemas/settings.py) and
[`schemas/law_settings.py`](../../schemas/law_settings.py).

```sh
surefoot run moving-platform-slow --set tsid.base_kp=120 --set dik.k_force=-40
surefoot run moving-platform-slow --settings my-settings.toml
```

A settings file has a table per section and names only what it changes; `--set` wins
over it. One number given for a setting with several axes stands for all of them. A name
that does not exist is refused, with the nearest one that does. Each run keeps its
settings, all of them, in `settings.toml`. Settings with a ● can also be changed while
the stabilizer runs, from the live page or by a request on `srv/settings`; they move to
their new value over half a second. Unit 1 stands for a number without one.
"""
_COLUMNS = ("name", "default", "unit", "range", "text")


def settings_page() -> str:
    """Markdown with a table for each section."""
    parts = [_HEAD]
    for section in msgspec.structs.fields(ControllerSettings):
        rows = [_marked(row, section.name) for row in field_rows(section.type)]
        parts.append(
            f"## `{section.name}`\n\n{literals(first_line(section.type))}\n\n"
            + table(rows, _COLUMNS)
        )
    return "\n".join([*parts, _presets()])


def _marked(row: FieldRow, section: str) -> FieldRow:
    """The row, with a mark when the setting can change during a run."""
    is_live = f"{section}.{row.name}" in LIVE_SETTINGS
    return replace(row, text=f"{row.text} ●") if is_live else row


def _presets() -> str:
    lines = ["## Presets\n\n`whole_body.preset` sets several at once.\n"]
    for name in PRESETS:
        pairs = [
            f"`{section}.{key} = {value_words(value)}`"
            for section, values in PRESETS[name].items()
            for key, value in values.items()
        ]
        lines.append(f"- `{name}`: {', '.join(pairs) or 'the defaults above'}")
    return "\n".join(lines) + "\n"
