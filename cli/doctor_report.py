"""What ``surefoot doctor`` tells: packages and what is missing, line by line."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Callable, Iterator
from enum import StrEnum
from importlib.metadata import requires
from pathlib import Path

import msgspec

from surefoot.installation import install_command, installed_version

LEAST_PYTHON = (3, 11)
_EXTRAS = {
    "view": ("viser", "yourdfpy", "plotly"),
    "parquet": ("pyarrow",),
    "tune": ("optuna",),
    "cluster": ("distributed",),
}
"""Packages of each optional part."""


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


def finding(
    name: str, got: str, *, bad: Severity | None = None, advice: str = ""
) -> Diagnosis:
    """Make a finding that has advice only if something is bad."""
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
    yield check_python()
    yield from check_packages()
    yield from check_extras()


def _computing() -> Iterator[Diagnosis]:
    from surefoot.cli import doctor_machine as machine

    yield machine.check_msgpack()
    yield machine.check_processors()
    yield machine.check_clock()
    yield machine.check_priority()
    yield machine.check_blas()


def _surroundings() -> Iterator[Diagnosis]:
    from surefoot.cli import doctor_machine as machine

    yield machine.check_bus()
    yield machine.check_port()
    yield from machine.check_disk()
    yield machine.check_pictures()
    yield machine.check_browser()


def _robots() -> Iterator[Diagnosis]:
    """Check the margins of every shipped robot with every servo profile."""
    from surefoot.controllers import compute_margins
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
        advice = import_advice(error)
        yield finding(name, str(error), bad=Severity.FAIL, advice=advice)


PINS = Path(__file__).resolve().parents[1] / "constraints.txt"
_NAME = re.compile(r"[A-Za-z0-9._-]+")
_EXTRA = re.compile(r"extra\s*==")


def check_python() -> Diagnosis:
    """Check that Python is new enough."""
    wanted = ".".join(map(str, LEAST_PYTHON))
    is_old = sys.version_info < LEAST_PYTHON
    return finding(
        "Python",
        f"{platform.python_version()} on {platform.platform(terse=True)}",
        bad=Severity.FAIL if is_old else None,
        advice=f"install Python {wanted} or newer",
    )


def check_packages() -> list[Diagnosis]:
    """Check packages: one line for all good ones, and one for each other."""
    names = required_packages()
    pins = read_pins(PINS)
    found, others = [], []
    for name in names:
        got = installed_version(name)
        pin = pins.get(_normal(name), got)
        if got == pin and got is not None:
            found.append(f"{name} {got}")
            continue
        others.append(
            finding(
                f"package {name}",
                f"{got}, tested with {pin}" if got else "not installed",
                bad=Severity.WARN if got else Severity.FAIL,
                advice=f"pip install {name}=={pin}" if got else install_command(),
            )
        )
    against = "as tested" if pins else "no constraints.txt to compare with"
    told = f"surefoot {installed_version('surefoot')}, {', '.join(found)}; {against}"
    return [finding("packages", told), *others]


def check_extras() -> list[Diagnosis]:
    """Check the optional parts; each missing one comes with how to get it."""
    findings = []
    for extra, packages in _EXTRAS.items():
        missing = [name for name in packages if installed_version(name) is None]
        there = [f"{name} {installed_version(name)}" for name in packages]
        findings.append(
            finding(
                f"extra {extra}",
                f"no {', '.join(missing)}" if missing else ", ".join(there),
                bad=Severity.WARN if missing else None,
                advice=f"only if you want it: {install_command(extra)}",
            )
        )
    return findings


def required_packages() -> list[str]:
    """Return the packages that surefoot always needs, from its metadata."""
    wanted = requires("surefoot") or []
    matches = (_NAME.match(line) for line in wanted if not _EXTRA.search(line))
    return [match.group() for match in matches if match]


def read_pins(path: Path) -> dict[str, str]:
    """Read the versions of a constraints file by normalised name; empty without one."""
    if not path.is_file():
        return {}
    lines = (line.strip() for line in path.read_text(encoding="utf-8").splitlines())
    pairs = (line.split("==", 1) for line in lines if "==" in line and line[0] != "#")
    return {_normal(name): pin for name, pin in pairs}


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
