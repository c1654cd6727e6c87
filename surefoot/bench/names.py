"""Names that are asked for, and names of files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TypeVar

from surefoot.errors import UsageError
from surefoot.schemas.key_names import nearest

Name = TypeVar("Name", bound=str)


def known_names(
    names: Sequence[str], valid: Sequence[Name], *, what: str
) -> list[Name]:
    """Return the names asked for, all of them valid.

    Args:
        names: asked for.
        valid: all there are.
        what: they are, in a word.

    Raises:
        UsageError: one is not; the message lists all.
    """
    known = {str(name): name for name in valid}
    for name in names:
        if name not in known:
            raise UsageError(
                f"{what}: got {name!r}{nearest(name, valid)}; expected one of "
                f"{', '.join(valid)}"
            )
    return [known[name] for name in names]


def plain(words: str) -> str:
    """Return words as the name of a file."""
    return re.sub(r"[^a-z0-9.]+", "_", words.lower()).strip("_")
