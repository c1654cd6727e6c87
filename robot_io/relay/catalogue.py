"""Relay plans that come with the package, by name; others by path."""

from __future__ import annotations

import difflib
from pathlib import Path

from surefoot.schemas.errors import FileFormatError

PLANS_DIR = Path(__file__).parent / "plans"


def list_plans() -> list[str]:
    """Return the names of the shipped plans, sorted."""
    return sorted(path.stem for path in PLANS_DIR.glob("*.toml"))


def find_plan(name_or_path: str) -> Path:
    """Return the path of a plan, given a shipped name or a path.

    Raises:
        FileFormatError: there is no such plan; the message names the nearest.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        if path.is_file():
            return path
        raise FileFormatError(f"{path}: no such relay plan")
    names = list_plans()
    if name_or_path in names:
        return PLANS_DIR / f"{name_or_path}.toml"
    near = difflib.get_close_matches(name_or_path, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise FileFormatError(
        f"no relay plan named {name_or_path!r}; {hint}shipped are "
        f"{', '.join(names)}, or give the path of a plan (.toml)"
    )
