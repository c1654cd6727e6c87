"""Figures in the files of EUROBENCH: one YAML each, a scalar or a vector."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from surefoot.robot_io.atomic_file import atomic_file

Number = float | int | None


def write_scalar(path: Path, value: Number, *, label: str) -> None:
    """Write one figure.

    Args:
        path: of the file.
        value: None for what could not be told.
        label: what it is, with its unit.
    """
    _write(path, "scalar", json.dumps(label), _number(value))


def write_vector(
    path: Path, values: Sequence[Number], *, labels: Sequence[str]
) -> None:
    """Write figures that belong together.

    Args:
        path: of the file.
        values: None for what could not be told.
        labels: of each, with its unit.
    """
    numbers = ", ".join(map(_number, values))
    _write(path, "vector", json.dumps(list(labels)), f"[{numbers}]")


def _number(value: Number) -> str:
    if value is None or not math.isfinite(value):
        return ".nan"
    # YAML 1.1 takes 1e-05 for a text: a number needs a point before the exponent.
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return text if not e or "." in mantissa else f"{mantissa}.0e{exponent}"


def _write(path: Path, kind: str, label: str, value: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        file.write(f"type: {kind}\nlabel: {label}\nvalue: {value}\n".encode())
