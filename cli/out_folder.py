"""Makes the folder that ``--out`` names, or says why it cannot."""

from __future__ import annotations

from pathlib import Path

from cli.errors import EnvironmentFailedError, UsageError


def make_out_folder(folder: Path, *, out: Path) -> None:
    """Makes a folder, with those above it.

    Args:
        folder: to be made; may be there already.
        out: what the user gave, for the message.

    Raises:
        UsageError: something on the way is a file.
        EnvironmentFailedError: it cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{out.name}.probe"
        probe.touch()
        probe.unlink()
    except (FileExistsError, NotADirectoryError) as error:
        raise UsageError(f"--out {out}: {folder} is not a folder") from error
    except OSError as error:
        raise EnvironmentFailedError(
            f"--out {out}: cannot write in {folder} ({error.strerror or error}); name "
            "a folder that can be written to, on a disk with room"
        ) from error
