"""Keeps a QP that could not be solved, to be replayed."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path

import numpy as np

from stabilizer.qp import QpData


def save_failure(data: QpData, path: Path) -> None:
    """Writes a problem as .npz, whole or not at all.

    Args:
        data: the problem; ``np.load(path)`` gives its matrices by the same names.
        path: file to write; an older one is replaced.

    Raises:
        OSError: it cannot be written there.
    """
    unfinished = path.with_name(path.name + ".part")
    with unfinished.open("wb") as file:
        np.savez(file, **asdict(data))
    os.replace(unfinished, path)
