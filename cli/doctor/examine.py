"""All checks of the doctor, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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


def examine() -> Iterator[Diagnosis]:
    """Look at everything; a check that cannot be done is a finding of its own."""
    yield from _try("packages", _packages)
    # What follows needs packages; without one of them it says so.
    for name, check in (
        ("linear algebra", _computing),
        ("bus, disk, pictures", _surroundings),
        ("margins", _robots),
    ):
        yield from _try(name, check)


def _packages() -> Iterator[Diagnosis]:
    from surefoot.cli.doctor.packages import check_extras, check_packages, check_python

    yield check_python()
    yield from check_packages()
    yield from check_extras()


def _computing() -> Iterator[Diagnosis]:
    from surefoot.cli.doctor import computing

    yield computing.check_msgpack()
    yield computing.check_processors()
    yield computing.check_clock()
    yield computing.check_priority()
    yield computing.check_blas()


def _surroundings() -> Iterator[Diagnosis]:
    from surefoot.cli.doctor import surroundings

    yield surroundings.check_bus()
    yield surroundings.check_port()
    yield from surroundings.check_disk()
    yield surroundings.check_pictures()
    yield surroundings.check_browser()


def _robots() -> Iterator[Diagnosis]:
    """Check the margins of every shipped robot with every servo profile."""
    from surefoot.loop_margins import compute_margins
    from surefoot.robot_io.robot import list_robots, load_robot

    for name in list_robots():
        for profile in load_robot(name).file.servo.profiles:
            found = compute_margins(name, servo_profile=profile)
            yield finding(
                f"margins of {name}, {profile}",
                "; ".join(found.in_words()),
                bad=None if found.is_enough else Severity.WARN,
                advice="as it was made, and no fault of this machine; surefoot "
                "margins tells more",
            )


def _try(name: str, check: Callable[[], Iterator[Diagnosis]]) -> Iterator[Diagnosis]:
    from surefoot.cli.console import import_advice

    try:
        yield from check()
    except ImportError as error:
        yield Diagnosis(
            name=name,
            verdict=Severity.FAIL,
            got=str(error),
            advice=import_advice(error),
        )
