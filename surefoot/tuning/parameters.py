"""Parameters of a search: settings, within the ranges that they allow."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, cast

import msgspec
from msgspec import inspect

from surefoot.errors import UsageError
from surefoot.presentation import split_unit
from surefoot.schemas.json_schema import field_docs
from surefoot.schemas.settings import ControllerSettings, setting_names, setting_of
from surefoot.schemas.toml_file import override_texts
from surefoot.schemas.validation import nearest

if TYPE_CHECKING:
    import optuna

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
"""Names of the numbers of a setting with several: the first ones, as many as it has."""
FACTOR = 4.0
"""Factor by which a setting without range or limit varies to both sides."""
LOG_RATIO = 10.0
"""Ratio of a positive range's ends from which it is searched by its logarithm."""
MOST_CHOICES = 1000
"""Largest number of choices in a range of whole numbers."""
DIGITS = 4
"""Significant digits of the values found."""

Value = int | float | str | bool


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """A setting, or one axis of it, and its range or choices."""

    setting: str
    """Setting as ``section.name``."""
    axis: int | None = None
    """Index of one of several numbers; None: the same value for all."""
    low: float = 0.0
    """Lower end of the range."""
    high: float = 0.0
    """Upper end of the range."""
    choices: list[Value] = []
    """Choices instead of a range."""
    unit: str = ""
    """Unit of its numbers, from the setting's description."""
    about: str = ""
    """The setting's description."""

    @property
    def name(self) -> str:
        """Its name, as the user gives it: ``dik.k_force.z``."""
        return (
            self.setting if self.axis is None else f"{self.setting}.{AXES[self.axis]}"
        )

    @property
    def is_log(self) -> bool:
        """Whether it is searched by its logarithm."""
        return self.low > 0.0 and self.high >= LOG_RATIO * self.low

    def suggest(self, trial: optuna.Trial) -> Value:
        """Return the value that a trial proposes; see :meth:`used`."""
        if self.choices:
            chosen = trial.suggest_categorical(self.name, self.choices)
            return cast(Value, chosen)
        return trial.suggest_float(self.name, self.low, self.high, log=self.is_log)

    def used(self, value: Value, *, start: Value) -> Value:
        """Return a proposed value as runs have it: rounded, unless the user gave it."""
        if self.choices or value == start:
            return value
        few_digits = float(f"{value:.{DIGITS}g}")
        return min(max(few_digits, self.low), self.high)

    def present(self, settings: ControllerSettings) -> Value:
        """Return its value in some settings.

        Raises:
            UsageError: its numbers differ, and no axis is named.
        """
        value = setting_of(settings, self.setting)
        if not isinstance(value, tuple):
            return cast(Value, value)
        if self.axis is not None:
            return float(value[self.axis])
        if len(set(value)) > 1:
            raise UsageError(
                f"--params {self.setting}: is {list(value)} to begin with; name an "
                f"axis, such as {self.setting}.{AXES[0]}"
            )
        return float(value[0])

    def check_start(self, settings: ControllerSettings) -> None:
        """Check that the search can begin with these settings.

        Raises:
            UsageError: their value is out of the parameter's range.
        """
        value = self.present(settings)
        inside = (
            value in self.choices
            if self.choices
            else self.low <= float(value) <= self.high
        )
        if not inside:
            raise UsageError(
                f"--params {self.name}: is {value} to begin with, out of what is to be "
                f"searched ({self.extent}); widen it, or begin elsewhere with "
                f"--set {self.setting}=..."
            )

    @property
    def extent(self) -> str:
        """Its range or choices, in words."""
        if self.choices:
            return ", ".join(map(str, self.choices))
        return f"{self.low:g} to {self.high:g}"


def parse_parameter(text: str, *, start: ControllerSettings) -> Parameter:
    """Parse ``SETTING=LOW:HIGH``, ``SETTING=A,B,C`` or ``SETTING``.

    Args:
        text: the setting may name one axis of several: ``dik.k_force.z``. Without a
            range the setting's own limits count, or a factor of 4 to both sides of its
            start if it has none.
        start: settings at the start of the search.

    Raises:
        UsageError: no such setting, or a range that it does not allow.
    """
    name, equals, values = (part.strip() for part in text.partition("="))
    setting, axis = _split(name)
    kind, about = _kind(setting)
    numbers = kind.item_types if isinstance(kind, inspect.TupleType) else (kind,)
    if axis is not None and (len(numbers) == 1 or axis >= len(numbers)):
        axes = ", ".join(AXES[: len(numbers)]) if len(numbers) > 1 else "no axes"
        raise UsageError(f"--params {name}: {setting} has {axes}")
    plain = Parameter(setting=setting, axis=axis, unit=unit_of(setting), about=about)
    number = numbers[axis or 0]
    if isinstance(number, inspect.LiteralType):
        return _choice(plain, values, allowed=number.values)
    assert isinstance(number, (inspect.FloatType, inspect.IntType))
    if isinstance(number, inspect.IntType) and ":" in values:
        ends = [_whole(end, text) for end in _range(values, text)]
        if ends[1] - ends[0] >= MOST_CHOICES:
            raise UsageError(
                f"--params {text}: holds {ends[1] - ends[0] + 1:g} whole numbers, "
                f"expected at most {MOST_CHOICES}; give a smaller range, or a list"
            )
        values = ",".join(map(str, range(ends[0], ends[1] + 1)))
    if equals and ":" not in values:
        chosen: list[Value] = [_number(part, text) for part in values.split(",")]
        if isinstance(number, inspect.IntType):
            chosen = [_whole(float(value), text) for value in chosen]
        for value in chosen:
            _check_allowed(plain.name, float(value), number)
        if len(set(chosen)) < len(chosen):
            raise UsageError(f"--params {text}: names a value twice")
        return msgspec.structs.replace(plain, choices=chosen)
    if isinstance(number, inspect.IntType):
        raise UsageError(
            f"--params {plain.name}: is a whole number; say which to try, such as "
            f"{plain.name}=1:4"
        )
    low, high = _range(values, text) if equals else _own_range(plain, number, start)
    _check_allowed(plain.name, low, number)
    _check_allowed(plain.name, high, number)
    return msgspec.structs.replace(plain, low=low, high=high)


def overrides_of(
    parameters: Sequence[Parameter],
    values: Mapping[str, Value],
    *,
    start: ControllerSettings,
) -> list[str]:
    """Return values as texts ``section.name=value`` over the settings at the start.

    Args:
        parameters: the searched parameters.
        values: by the name of the parameter.
        start: settings at the start; they give the axes that are not searched.
    """
    table: dict[str, Any] = {}
    for parameter in parameters:
        name, value = parameter.setting, values[parameter.name]
        if parameter.axis is None:
            table[name] = value
        else:
            table.setdefault(name, [*setting_of(start, name)])[parameter.axis] = value
    return override_texts(table)


def unit_of(setting: str) -> str:
    """Return a setting's unit: from its description, ``[1/s^2]``, or its name's suffix.

    Returns:
        Empty for a setting without a unit, and for a plain number.
    """
    section, key = setting.split(".")
    text = _docs(section).get(key, "")
    found = re.search(r"\[([^\]]+)\][^\[]*$", text)
    if found:
        return "" if found[1] == "1" else found[1]
    _, unit = split_unit(key)
    return "" if unit == "1" else unit


def _split(name: str) -> tuple[str, int | None]:
    """Split a name into setting and axis."""
    known = setting_names()
    head, _, tail = name.rpartition(".")
    if name in known:
        return name, None
    if head in known and tail in AXES:
        return head, AXES.index(tail)
    if head in known:
        raise UsageError(
            f"--params {name}: got {tail!r}, expected an axis: {', '.join(AXES)}"
        )
    raise UsageError(f"--params {name}: no such setting{nearest(name, known)}")


def _kind(setting: str) -> tuple[inspect.Type, str]:
    section, key = setting.split(".")
    (outer,) = (f for f in _fields(ControllerSettings) if f.name == section)
    assert isinstance(outer.type, inspect.StructType)
    (field,) = (f for f in outer.type.fields if f.name == key)
    about = re.split(r" \[|, x y z|[.;]", _docs(section).get(key, ""))[0]
    return field.type, about


def _fields(kind: type[msgspec.Struct]) -> tuple[inspect.Field, ...]:
    info = inspect.type_info(kind)
    assert isinstance(info, inspect.StructType)
    return info.fields


@cache
def _docs(section: str) -> dict[str, str]:
    (outer,) = (f for f in _fields(ControllerSettings) if f.name == section)
    assert isinstance(outer.type, inspect.StructType)
    return field_docs(outer.type.cls)


def _choice(plain: Parameter, values: str, *, allowed: Sequence[Any]) -> Parameter:
    chosen = [part.strip() for part in values.split(",")] if values else [*allowed]
    wrong = [value for value in chosen if value not in allowed]
    if wrong:
        raise UsageError(
            f"--params {plain.name}: got {', '.join(wrong)}, expected some of "
            f"{', '.join(map(str, allowed))}"
        )
    return msgspec.structs.replace(plain, choices=chosen)


def _number(part: str, text: str) -> float:
    try:
        value = float(part)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(
            f"--params {text}: got {part.strip()!r}, expected LOW:HIGH, such as "
            "tsid.com_kp=10:80, or numbers A,B,C"
        )
    return value


def _whole(value: float, text: str) -> int:
    if value != int(value):
        raise UsageError(f"--params {text}: got {value:g}, expected whole numbers")
    return int(value)


def _range(values: str, text: str) -> tuple[float, float]:
    low, _, high = values.partition(":")
    ends = _number(low, text), _number(high, text)
    if ends[0] >= ends[1]:
        raise UsageError(f"--params {text}: expected LOW below HIGH")
    return ends


def _own_range(
    plain: Parameter, number: inspect.FloatType, start: ControllerSettings
) -> tuple[float, float]:
    """The setting's own limits, or a factor to both sides if it has none."""
    begins = float(plain.present(start))
    ends = sorted((begins / FACTOR, begins * FACTOR))
    low = number.ge if number.ge is not None else ends[0]
    high = number.le if number.le is not None else ends[1]
    if number.le is None and number.ge is not None:
        low = max(number.ge, ends[0])
    if low >= high:
        raise UsageError(
            f"--params {plain.name}: begins at {begins:g}, from where no range "
            f"follows; give one: {plain.name}=LOW:HIGH"
        )
    return float(low), float(high)


def _check_allowed(
    name: str, value: float, number: inspect.FloatType | inspect.IntType
) -> None:
    limits: dict[str, tuple[float | None, Callable[[Any], bool]]] = {
        "at least": (number.ge, lambda limit: value >= limit),
        "more than": (number.gt, lambda limit: value > limit),
        "at most": (number.le, lambda limit: value <= limit),
        "less than": (number.lt, lambda limit: value < limit),
    }
    for words, (limit, holds) in limits.items():
        if limit is not None and not holds(limit):
            raise UsageError(
                f"--params {name}: got {value:g}, expected {words} {limit:g}"
            )
