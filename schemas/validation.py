"""Reads msgspec's validation errors: where, and what is wrong there."""

from __future__ import annotations

import re

import msgspec

_PLACE = re.compile(r" - at `(?:key` in `)?\$\.?([^`]*)`$")
_NAMED_FIELD = re.compile(r"field `([^`]+)`")


def explain(error: msgspec.ValidationError) -> tuple[str, str]:
    """Takes a validation error apart.

    Returns:
        Path of the offending field, such as ``platform[0].motion[1].axis`` (empty
        when the whole is at fault), and the complaint without the path.
    """
    text = str(error)
    place = _PLACE.search(text)
    path = place.group(1) if place else ""
    if place:
        text = text[: place.start()]
    named = _NAMED_FIELD.search(text)
    if named:
        path = f"{path}.{named.group(1)}" if path else named.group(1)
    return path, text
