"""One line of ``surefoot doctor``."""

from __future__ import annotations

from enum import StrEnum

import msgspec


class Severity(StrEnum):
    """How much a finding matters."""

    OK = "ok"
    WARN = "warn"
    """Something works less well, or an option is not there."""
    FAIL = "FAIL"
    """A run would stop here."""


class Diagnosis(msgspec.Struct, frozen=True, kw_only=True):
    """What was looked at, what was found, and what to do about it."""

    name: str
    verdict: Severity
    got: str
    advice: str = ""
    """What to do; empty when there is nothing to do."""


def finding(name: str, got: str, *, bad: Severity | None, advice: str) -> Diagnosis:
    """Make a finding that has advice only if something is bad.

    Args:
        name: what was looked at.
        got: what was found.
        bad: how bad it is; None when it is not.
        advice: what to do in that case.
    """
    if bad is None:
        return Diagnosis(name=name, verdict=Severity.OK, got=got)
    return Diagnosis(name=name, verdict=bad, got=got, advice=advice)
