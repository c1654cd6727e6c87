"""What was found, guessed, changed and left while a robot file was made."""

from __future__ import annotations

from typing import Literal, NamedTuple

NoteKind = Literal["found", "guessed", "changed", "left to you"]
KINDS: tuple[NoteKind, ...] = ("found", "changed", "guessed", "left to you")
_MOST_NAMES = 12


class Note(NamedTuple):
    """One line of the report.

    Attributes:
        kind: whose word it is: the URDF's, a change of it, a guess, or still to do.
        text: names what it is about.
    """

    kind: NoteKind
    text: str


def listed(names: list[str]) -> str:
    """Return names as a list in words, cut when there are many."""
    shown = ", ".join(names[:_MOST_NAMES])
    more = len(names) - _MOST_NAMES
    return f"{shown} and {more} more" if more > 0 else shown
