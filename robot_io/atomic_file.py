"""Files that appear under their name only once they are complete."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO


@contextmanager
def atomic_file(path: Path, *, overwrite: bool = True) -> Iterator[IO[bytes]]:
    """Open a file for writing that takes its name once it is complete.

    Until then it has a name of its own, ``NAME.<random>.partial``, so that two writers
    of one name do not write into one another's file.

    Args:
        path: its final name.
        overwrite: whether it replaces a file that has the name by then.

    Yields:
        The file, binary, to be written.

    Raises:
        FileExistsError: there is a file of that name now, and it may not be replaced.
    """
    partial = path.with_name(f"{path.name}.{secrets.token_hex(4)}.partial")
    try:
        with partial.open("xb") as file:
            yield file
        if overwrite:
            partial.replace(path)
        else:
            os.link(partial, path)  # unlike a renaming, it replaces nothing
    except OSError as error:
        error.filename = error.filename or str(path)  # a failed write names no file
        raise
    finally:
        partial.unlink(missing_ok=True)
