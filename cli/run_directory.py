"""The folder a run leaves behind: written aside, put in place when the run is over."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from types import TracebackType

from cli.errors import UsageError
from cli.out_folder import make_out_folder

MARKER = "run.json"
"""Every folder of a run holds this file; a folder without it is not overwritten."""


class RunDirectory:
    """Collects the files of a run and gives the folder its name at the end.

    ``with RunDirectory(out) as run: ... run.path / "result.json"``. Whatever stood
    under the name before stays whole until :meth:`keep` has put the new folder in
    its place; without :meth:`keep` (a failure before anything was worth keeping,
    Ctrl-C) nothing is left behind.

    Attributes:
        out: where the folder goes; None for a run that keeps nothing.
        path: where files are written meanwhile.
    """

    def __init__(
        self, out: Path | None, *, marker: str = MARKER, content: str = "a run"
    ) -> None:
        """Checks the name before any work is done.

        Args:
            out: where the folder goes; None for a run that keeps nothing.
            marker: file that every folder of its kind holds.
            content: what such a folder is, for errors.

        Raises:
            UsageError: something of another kind stands under this name.
            EnvironmentFailedError: nothing can be written there.
        """
        self.out, self._marker, self._content = out, marker, content
        if out is None:
            self.path = Path(tempfile.mkdtemp(prefix="surefoot-"))
            return
        self._check_free(out)
        make_out_folder(out.parent, out=out)
        self.path = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
        self.path.chmod(0o755)

    def __enter__(self) -> RunDirectory:
        """Gives itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Removes what was not kept."""
        shutil.rmtree(self.path, ignore_errors=True)

    def keep(self) -> None:
        """Puts the folder in its place; a former run there is replaced."""
        if self.out is None:
            return
        self._check_free(self.out)
        former = None
        if self.out.exists():
            former = Path(tempfile.mkdtemp(prefix=".former-", dir=self.out.parent))
            self.out.rename(former / "run")
        self.path.rename(self.out)
        if former is not None:
            shutil.rmtree(former, ignore_errors=True)

    def _check_free(self, out: Path) -> None:
        if not out.exists():
            return
        if not out.is_dir():
            raise UsageError(f"--out {out}: is a file, expected a folder or a new name")
        if any(out.iterdir()) and not (out / self._marker).is_file():
            raise UsageError(
                f"--out {out}: holds other files than {self._content} of surefoot; "
                "name an empty or new folder"
            )
