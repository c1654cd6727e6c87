"""Outcome of a conformance run."""

from __future__ import annotations

import msgspec


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the run."""

    name: str
    """What was checked, such as ``imu.gravity``."""
    passed: bool
    got: str
    """What was seen."""
    expected: str
    """What should have been."""


class ConformanceReport(msgspec.Struct, frozen=True, kw_only=True):
    """A whole run."""

    robot: str
    passed: bool
    """Whether every finding did."""
    findings: list[CheckResult]


class RunBrokenOffError(Exception):
    """Nothing further can be checked; the last finding says why."""


class Findings:
    """Collects findings in the order of the run."""

    def __init__(self) -> None:
        """Start empty."""
        self.all: list[CheckResult] = []

    def add(self, name: str, passed: bool, *, got: str, expected: str) -> bool:
        """Note a finding; returns whether it passed."""
        passed = bool(passed)
        self.all.append(
            CheckResult(name=name, passed=passed, got=got, expected=expected)
        )
        return passed

    def need(self, name: str, passed: bool, *, got: str, expected: str) -> None:
        """Note a finding that the rest depends on.

        Raises:
            RunBrokenOffError: it did not pass.
        """
        if not self.add(name, passed, got=got, expected=expected):
            raise RunBrokenOffError(name)
