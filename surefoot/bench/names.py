"""Names that are asked for, and names of files."""

from __future__ import annotations

import re
from collections.abc import Sequence

from surefoot.errors import UsageError
from surefoot.schemas.key_names import nearest


def check_names(names: Sequence[str], valid: Sequence[str], *, what: str) -> None:
    """See that all names are valid.

    Args:
        names: asked for.
        valid: all there are.
        what: they are, in a word.

    Raises:
        UsageError: one is not; the message lists all.
    """
    for name in names:
        if name not in valid:
            raise UsageError(
                f"{what}: got {name!r}{nearest(name, valid)}; expected one of "
                f"{', '.join(valid)}"
            )


def plain(words: str) -> str:
    """Return words as the name of a file."""
    return re.sub(r"[^a-z0-9.]+", "_", words.lower()).strip("_")
