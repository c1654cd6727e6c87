"""The findings of ``surefoot doctor`` on Python and packages."""

from __future__ import annotations

import platform
import re
import sys
from enum import StrEnum
from importlib.metadata import requires
from importlib.util import find_spec
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
"""Packages that each extra needs."""
PINS = Path(__file__).resolve().parents[1] / "constraints.txt"
_NAME = re.compile(r"[A-Za-z0-9._-]+")
_EXTRA = re.compile(r"extra\s*==")


class Severity(StrEnum):
    """How serious a finding is."""

    OK = "ok"
    WARN = "warn"
    """Something works less well, or an option is missing."""
    FAIL = "FAIL"
    """A run would stop here."""


class Diagnosis(msgspec.Struct, frozen=True, kw_only=True):
    """One finding: what was checked, the result, and what to do."""

    name: str
    verdict: Severity
    got: str
    advice: str = ""
    """What to do; empty when nothing is to be done."""


def finding(
    name: str, got: str, *, bad: bool, advice: str, as_bad_as: Severity = Severity.WARN
) -> Diagnosis:
    """Make a finding; it is OK and has no advice unless something is bad."""
    if not bad:
        return Diagnosis(name=name, verdict=Severity.OK, got=got)
    return Diagnosis(name=name, verdict=as_bad_as, got=got, advice=advice)


def check_python() -> Diagnosis:
    """Check that Python is new enough."""
    return finding(
        "Python",
        f"{platform.python_version()} on {platform.platform(terse=True)}",
        bad=sys.version_info < LEAST_PYTHON,
        as_bad_as=Severity.FAIL,
        advice=f"install Python {'.'.join(map(str, LEAST_PYTHON))} or newer",
    )


def check_packages() -> list[Diagnosis]:
    """Check packages: one finding for all that are as tested, one for each other."""
    pins = read_pins(PINS)
    found, others = [], []
    for name in required_packages():
        got = installed_version(name)
        pin = pins.get(_normal(name), got)
        if got == pin and got is not None:
            found.append(f"{name} {got}")
            continue
        others.append(
            finding(
                f"package {name}",
                f"{got}, tested with {pin}" if got else "not installed",
                bad=True,
                as_bad_as=Severity.WARN if got else Severity.FAIL,
                advice=f"pip install {name}=={pin}" if got else install_command(),
            )
        )
    against = "as tested" if pins else "no constraints.txt to compare with"
    told = f"surefoot {installed_version('surefoot')}, {', '.join(found)}; {against}"
    return [finding("packages", told, bad=False, advice=""), *others]


def check_extras() -> list[Diagnosis]:
    """Check the extras; a missing one comes with the command that installs it."""
    findings = []
    for extra, packages in _EXTRAS.items():
        missing = [name for name in packages if installed_version(name) is None]
        there = [f"{name} {installed_version(name)}" for name in packages]
        findings.append(
            finding(
                f"extra {extra}",
                f"no {', '.join(missing)}" if missing else ", ".join(there),
                bad=bool(missing),
                advice=f"only if you want it: {install_command(extra)}",
            )
        )
    return findings


def check_msgpack() -> Diagnosis:
    """Check that MessagePack has its compiled extension."""
    is_compiled = find_spec("msgpack._cmsgpack") is not None
    return finding(
        "MessagePack",
        "compiled" if is_compiled else "pure Python",
        bad=not is_compiled,
        advice="pip install --force-reinstall --only-binary :all: msgpack; pure Python "
        "takes ten times as long to say what is wrong with a message",
    )


def required_packages() -> list[str]:
    """Return the packages that surefoot always needs, from its metadata."""
    wanted = requires("surefoot") or []
    matches = (_NAME.match(line) for line in wanted if not _EXTRA.search(line))
    return [match.group() for match in matches if match]


def read_pins(path: Path) -> dict[str, str]:
    """Read a constraints file: version by normalised name; empty if there is none."""
    if not path.is_file():
        return {}
    lines = (line.strip() for line in path.read_text(encoding="utf-8").splitlines())
    pairs = (line.split("==", 1) for line in lines if "==" in line and line[0] != "#")
    return {_normal(name): pin for name, pin in pairs}


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
