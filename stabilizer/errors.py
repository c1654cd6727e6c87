"""Errors of the stabilizer's package."""

from __future__ import annotations

from enum import StrEnum


class StabilizerError(RuntimeError):
    """The stabilizer cannot do what was asked."""


class ControllerError(StabilizerError, ValueError):
    """A controller cannot be found or made, or breaks the controller protocol."""


class QpStatus(StrEnum):
    """Outcome of a QP."""

    OK = "ok"
    """Solved."""
    NOT_TRIED = "not tried"
    """Not tried, since an earlier step failed."""
    SENSORS_NOT_FINITE = "sensors not finite"
    """Not tried, since a sensor reading was not finite."""
    NO_CONTACT = "no contact"
    """No foot stands, so there are no contact wrenches."""
    SINGULAR_CONTACT = "singular contact"
    """The standing feet cannot move independently of each other."""
    NOT_FINITE = "not finite"
    """The problem contains numbers that are not finite."""
    PRIMAL_INFEASIBLE = "primal infeasible"
    """Its limits contradict each other."""
    DUAL_INFEASIBLE = "dual infeasible"
    """Its cost has no lower bound."""
    ITERATION_LIMIT = "iteration limit reached"
    """The solver gave up before it converged."""
    NUMERICS = "numerical trouble"
    """The solver's own factorisation failed."""
    UNSOLVED = "unsolved"
    """The solver did not say why."""
