"""Errors of the simulated robot."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class SimulationError(RuntimeError):
    """The simulated robot cannot do what was requested."""


class ScenarioError(SimulationError, ValueError):
    """A scenario requests something that this robot or simulation cannot do.

    Attributes:
        field: path of the offending key, such as ``push[0].body``.
    """

    def __init__(self, message: str, *, field: str = "") -> None:
        """Keep the path of the offending key beside the message."""
        super().__init__(message)
        self.field = field


@contextmanager
def within(path: str) -> Iterator[None]:
    """Put a path before the key of a :class:`ScenarioError` raised inside."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(f"{path}.{error}", field=f"{path}.{error.field}") from error


class CommandError(SimulationError, ValueError):
    """A command has the wrong size, or answers a tick that is not open."""


class RenderError(SimulationError):
    """No picture can be drawn here; the message says what to install or set."""
