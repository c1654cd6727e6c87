"""Puts the scenario's file before what is found wrong with it only in the world."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sim_robot.errors import ScenarioError


@contextmanager
def naming_scenario(path: Path) -> Iterator[None]:
    """Names the file in a :class:`ScenarioError` that says which key is wrong.

    Bodies, ticks and ranges are checked where robot and scenario come together, which
    know nothing of files.

    Args:
        path: of the scenario.
    """
    try:
        yield
    except ScenarioError as error:
        if not error.field:
            raise
        raise ScenarioError(f"{path}: {error}", field=error.field) from error
