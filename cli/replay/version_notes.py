"""Which software a record was made with, against what runs now."""

from __future__ import annotations

from typing import Any

import msgspec


def version_notes(recorded: bytes | None, present: dict[str, Any]) -> list[str]:
    """What is other than it was, in words; nothing when all is the same.

    Args:
        recorded: the attached description; None when there is none.
        present: the same of this process.
    """
    if recorded is None:
        return ["the record does not say which versions it was made with"]
    then: dict[str, Any] = msgspec.json.decode(recorded)
    notes = [
        f"{name}: recorded with {then.get(name)}, now {present[name]}"
        for name in ("python", "platform")
        if then.get(name) != present[name]
    ]
    packages = then.get("packages") or {}
    notes += [
        f"{name}: recorded with {packages.get(name)}, now {version}"
        for name, version in present["packages"].items()
        if packages.get(name) != version
    ]
    return notes + _code_notes(then, present)


def _code_notes(then: dict[str, Any], present: dict[str, Any]) -> list[str]:
    before, now = then.get("git_commit"), present["git_commit"]
    notes = []
    if before != now:
        notes.append(f"code: recorded at commit {_short(before)}, now {_short(now)}")
    for when, about in (("when recorded", then), ("now", present)):
        changed = about.get("git_changed_files") or []
        if changed:
            notes.append(f"code: {len(changed)} files not committed {when}")
    return notes


def _short(commit: str | None) -> str:
    return "unknown" if commit is None else commit[:12]
