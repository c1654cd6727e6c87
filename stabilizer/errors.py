"""Errors of the stabilizer's package."""

from __future__ import annotations


class StabilizerError(RuntimeError):
    """The stabilizer cannot do what it was asked for."""


class ControllerError(StabilizerError, ValueError):
    """A controller cannot be found or made, or breaks the controller protocol."""
