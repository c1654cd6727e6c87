"""What ``surefoot sweep`` is asked, from its texts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

from surefoot.errors import UsageError
from surefoot.schemas.scenario_paths import parse_override, parse_value
from surefoot.studies.cell import Cell
from surefoot.studies.study import make_cells


def parse_seeds(text: str) -> list[int]:
    """Parse seeds such as ``0:50`` (0 to 49) or ``1,4,7``.

    Raises:
        UsageError: neither.
    """
    first, colon, end = text.partition(":")
    try:
        numbers = text.split(",")
        seeds = list(range(int(first), int(end))) if colon else [*map(int, numbers)]
    except ValueError:
        seeds = []
    if not seeds or min(seeds) < 0:
        raise UsageError(
            f"--seeds {text!r}: expected FROM:TO, such as 0:50 for 50 seeds, or a "
            "list such as 1,4,7"
        )
    return seeds


def parse_vary(text: str) -> list[tuple[str, Any]]:
    """Parse ``PATH=A,B,C``, or ``PATH=FROM:TO:COUNT`` for evenly spaced numbers.

    Raises:
        UsageError: neither.
    """
    path, equals, values = text.partition("=")
    path = path.strip()
    if not equals or not values.strip():
        raise UsageError(
            f"--vary {text!r}: expected PATH=A,B,C or PATH=FROM:TO:COUNT, such as "
            "friction=0.4:1.0:7"
        )
    if values.count(":") == 2:
        return [(path, level) for level in _spaced(text, values)]
    if values.lstrip().startswith("["):
        return [parse_override(text, option="--vary")]
    what = f"--vary {path}"
    return [(path, parse_value(part, what=what)) for part in values.split(",")]


def _spaced(text: str, values: str) -> list[float]:
    first, last, count = values.split(":")
    try:
        low, high, n = float(first), float(last), int(count)
    except ValueError:
        n = 0
    if n < 2:
        raise UsageError(
            f"--vary {text!r}: expected numbers FROM:TO:COUNT with a count of 2 or more"
        )
    return [low + (high - low) * i / (n - 1) for i in range(n)]


def all_cells(
    scenarios: Sequence[str],
    *,
    vary: Sequence[str],
    variants: Sequence[str],
    servo_profiles: Sequence[str],
    seeds: Sequence[int],
) -> list[Cell]:
    """Return every combination; a whole round of all cases before the next seed.

    Raises:
        UsageError: a name or a text that cannot be read.
    """
    return make_cells(
        scenarios,
        combinations=list(product(*(parse_vary(text) for text in vary))),
        controllers=variants,
        servo_profiles=servo_profiles,
        seeds=seeds,
    )
