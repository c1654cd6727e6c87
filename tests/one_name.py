"""Finds modules that were loaded under two names."""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

from tests.command import REPOSITORY


def modules_with_two_names() -> dict[str, list[str]]:
    """Return the files of this repository that have several names, with the names."""
    names: dict[str, list[str]] = defaultdict(list)
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file is not None and name != "__main__":
            path = Path(file).resolve()
            ours = path.is_relative_to(REPOSITORY)
            if ours and "site-packages" not in path.parts:
                names[str(path)].append(name)
    return {file: sorted(each) for file, each in names.items() if len(each) > 1}
