"""Writes plain tables as TOML, which the standard library only reads."""

from __future__ import annotations

import json
from typing import Any


def toml_text(tables: dict[str, dict[str, Any]]) -> str:
    """Writes tables of numbers, texts, booleans and lists of them.

    Args:
        tables: table name to its keys; both plain names.

    Returns:
        TOML that reads back as the same tables.
    """
    blocks = []
    for name, table in tables.items():
        blocks.append(f"[{name}]\n{toml_keys(table)}")
    return "\n\n".join(blocks) + "\n"


def toml_keys(table: dict[str, Any]) -> str:
    """Writes the keys of one table, without its name."""
    return "\n".join(f"{key} = {_value(value)}" for key, value in table.items())


def _value(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_value, value))}]"
    # JSON and TOML write booleans, finite numbers and escapes alike; but TOML wants
    # characters beyond the 16-bit plane as they are, and DEL escaped.
    text = json.dumps(value, allow_nan=False, ensure_ascii=False)
    return text.replace("\x7f", "\\u007F")
