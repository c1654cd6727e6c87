"""Settings that may change while the controller runs: gains, none of the limits."""

from __future__ import annotations

import difflib
from typing import Any

import msgspec

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.toml_file import convert

LIVE_SETTINGS = (
    "tsid.com_kp",
    "tsid.com_kd",
    "tsid.base_kp",
    "tsid.base_kd",
    "tsid.posture_kp",
    "tsid.posture_kd",
    "dik.k_force",
    "dik.com_gain",
    "dik.base_gain",
    "dik.posture_gain",
    "dik.stance_leak",
    "ground.gain",
)
"""Every other setting is read once, when the controller is made."""

Values = dict[str, list[float]]
"""Setting to its value, one number per axis."""


def live_values(settings: ControllerSettings) -> Values:
    """Return the settings that may change, with their present values."""
    return {name: _numbers(_get(settings, name)) for name in LIVE_SETTINGS}


def with_values(settings: ControllerSettings, values: Values) -> ControllerSettings:
    """Return settings with some values replaced.

    Args:
        settings: where to start from.
        values: of some of LIVE_SETTINGS: one number for all axes, or one per axis.

    Raises:
        FileFormatError: no such setting, one that cannot change during a run, or a
            value out of range.
    """
    tables: dict[str, dict[str, Any]] = msgspec.to_builtins(settings)
    for name, numbers in values.items():
        _check_name(name)
        section, key = name.split(".")
        axes = len(_numbers(_get(settings, name)))
        if len(numbers) not in (1, axes):
            raise FileFormatError(
                f"{name}: got {len(numbers)} numbers, expected 1 or {axes}", field=name
            )
        if isinstance(_get(settings, name), tuple):
            tables[section][key] = numbers * axes if len(numbers) == 1 else numbers
        else:
            tables[section][key] = numbers[0]
    return convert(tables, ControllerSettings, source="settings")


def between(before: Values, after: Values, *, share: float) -> Values:
    """Interpolate between two sets of values.

    Args:
        before: at share 0.
        after: the same settings at share 1.
        share: from 0 to 1.
    """
    return {
        name: [
            old + share * (new - old)
            for old, new in zip(before[name], after[name], strict=True)
        ]
        for name in after
    }


def _check_name(name: str) -> None:
    if name in LIVE_SETTINGS:
        return
    near = difflib.get_close_matches(name, LIVE_SETTINGS, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise FileFormatError(
        f"{name}: cannot be changed during a run{hint}; these can: "
        f"{', '.join(LIVE_SETTINGS)}",
        field=name,
    )


def _get(settings: ControllerSettings, name: str) -> Any:
    section, key = name.split(".")
    return getattr(getattr(settings, section), key)


def _numbers(value: Any) -> list[float]:
    return [float(x) for x in value] if isinstance(value, tuple) else [float(value)]
