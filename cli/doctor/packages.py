"""Python, and our packages against the versions they were tested with."""

from __future__ import annotations

import platform
import re
import sys
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from surefoot.cli.doctor.examine import Diagnosis, Severity, finding
from surefoot.installation import install_command

LEAST_PYTHON = (3, 11)
PINS = Path(__file__).resolve().parents[2] / "constraints.txt"
_NAME = re.compile(r"[A-Za-z0-9._-]+")
_EXTRA = re.compile(r"extra\s*==")
_EXTRAS = {
    "view": ("viser", "yourdfpy", "plotly"),
    "parquet": ("pyarrow",),
    "tune": ("optuna",),
    "cluster": ("distributed",),
}
"""Packages of each optional part."""


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
        got = _installed(name)
        pin = pins.get(_normal(name))
        if got is None:
            others.append(
                Diagnosis(
                    name=f"package {name}",
                    verdict=Severity.FAIL,
                    got="not installed",
                    advice=install_command(),
                )
            )
        elif pin is not None and got != pin:
            others.append(
                Diagnosis(
                    name=f"package {name}",
                    verdict=Severity.WARN,
                    got=f"{got}, tested with {pin}",
                    advice=f"pip install {name}=={pin}",
                )
            )
        else:
            found.append(f"{name} {got}")
    against = "as tested" if pins else "no constraints.txt to compare with"
    ok = Diagnosis(
        name="packages",
        verdict=Severity.OK,
        got=f"surefoot {_installed('surefoot')}, {', '.join(found)}; {against}",
    )
    return [ok, *others]


def check_extras() -> list[Diagnosis]:
    """Check the optional parts; each missing one comes with how to get it."""
    findings = []
    for extra, packages in _EXTRAS.items():
        missing = [name for name in packages if _installed(name) is None]
        there = [f"{name} {_installed(name)}" for name in packages]
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


def _installed(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
