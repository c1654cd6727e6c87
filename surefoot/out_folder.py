"""Output files and folders, claimed before the work begins; other files are left alone.

Every command that writes files uses it.
"""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO, Any, Self

import msgspec

from surefoot.errors import EnvironmentFailedError, UsageError
from surefoot.schemas.toml_file import atomic_file

_LOG = logging.getLogger(__name__)
_LONGEST_LINE = 4096
"""How much of a file is read to find its first line [bytes]."""
_FORMER, _GOING = ".former-", ".going"
"""Prefixes of the names of folders with the former files: while these may still be
brought back, and while they are being removed."""


def make_out_folder(folder: Path, *, out: Path, option: str = "--out") -> None:
    """Make a folder and its parents, and check that files can be written there.

    Args:
        folder: to be made.
        out: the path the user gave, for errors.
        option: the option it was given with, for errors.

    Raises:
        UsageError: a part of the path is a file, or a link to nothing.
        EnvironmentFailedError: the folder cannot be made or written to.
    """
    if folder.is_symlink() and not folder.exists():
        raise UsageError(f"{option} {out}: is a link to nothing; name a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (FileExistsError, NotADirectoryError) as error:
        file = next((above for above in folder.parents if above.is_file()), folder)
        raise UsageError(
            f"{option} {out}: {file} is not a folder; name a folder, or a new one"
        ) from error
    except OSError as error:
        raise EnvironmentFailedError(
            f"{option} {out}: cannot write in {folder} ({error.strerror or error}); "
            "name a folder that can be written to, on a disk with room"
        ) from error


def is_to_replace(path: Path, *, overwrite: bool) -> bool:
    """Return whether a file exists and may be replaced.

    Raises:
        UsageError: it exists and may not be replaced, or is no file but a folder, a
            device or a link to one.
    """
    is_there = path.exists() or path.is_symlink()
    if path.exists() and not path.is_file():
        raise UsageError(f"--out {path}: is there and no file; name a new file")
    if is_there and not overwrite:
        raise UsageError(
            f"--out {path}: is there already; name another place, or overwrite it "
            "(--overwrite)"
        )
    return is_there


def check_replaceable(path: Path, *, signature: str, overwrite: bool) -> None:
    """Check that a file does not exist, or that the same command wrote it.

    Args:
        path: the file.
        signature: text in the first line of such a file.
        overwrite: whether it may be replaced.

    Raises:
        UsageError: it exists, and may not be replaced or something else wrote it.
    """
    if not is_to_replace(path, overwrite=overwrite):
        return
    try:
        with path.open("rb") as file:
            is_ours = signature.encode() in file.readline(_LONGEST_LINE)
    except OSError:
        is_ours = False
    if not is_ours:
        raise UsageError(
            f"--out {path}: is there, and its first line does not say {signature!r}; "
            "it is left as it is, name another place"
        )


@contextmanager
def undone_on_error() -> Iterator[Callable[[Path], None]]:
    """Remove the files and folders made in this context if it ends with an error.

    Yields:
        A function to call with each path before it is made; existing paths stay.
    """
    made: list[Path] = []
    try:
        yield lambda path: made.extend(not_there(path))
    except BaseException:
        take_away(made)
        raise


def not_there(path: Path) -> list[Path]:
    """Return those of a path and its parents that do not exist yet."""
    return [p for p in (path, *path.parents) if not os.path.lexists(p)]


def take_away(made: Iterable[Path]) -> None:
    """Remove files, and those folders that hold nothing else."""
    for path in sorted(made, key=lambda p: len(p.parts), reverse=True):
        with suppress(OSError):  # never made, or it holds other files
            path.rmdir() if path.is_dir() else path.unlink()


def write_whole(path: Path, data: bytes) -> None:
    """Write a file completely or not at all."""
    with atomic_file(path) as file:
        file.write(data)


def write_json(path: Path, value: Any) -> None:
    """Write a struct, or built-in types, as indented JSON, completely or not at all."""
    write_whole(path, msgspec.json.format(json_bytes(value)) + b"\n")


def json_bytes(value: Any) -> bytes:
    """Return a struct, or built-in types, as JSON, whatever file names it holds."""
    try:
        return msgspec.json.encode(value)
    except UnicodeEncodeError:
        return msgspec.json.encode(_all_printable(msgspec.to_builtins(value)))


def printable(name: str) -> str:
    """Return a file name as text that JSON and pages can hold."""
    return os.fsencode(name).decode("utf-8", "replace")


def _all_printable(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, dict):
        return {_all_printable(key): _all_printable(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [*map(_all_printable, value)]
    return value


@contextmanager
def new_file(path: Path, *, overwrite: bool) -> Iterator[IO[bytes]]:
    """Open a file that gets its name once it is complete.

    Raises:
        UsageError: another command has taken the name meanwhile.
    """
    try:
        with atomic_file(path, overwrite=overwrite) as file:
            yield file
    except FileExistsError as error:
        raise UsageError(
            f"--out {path}: another command wrote it meanwhile, and it is left as it "
            "is; name another place"
        ) from error


class FolderLock:
    """Keeps other commands out of a folder until released or the process ends."""

    def __init__(self, folder: Path) -> None:
        """Lock the folder itself; the system frees the lock when this process ends.

        Raises:
            UsageError: another command holds the lock.
        """
        self._lock: int | None = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self.release()
            raise UsageError(
                f"--out {folder}: another command is writing there now; name "
                "another folder, or wait for it"
            ) from error
        except OSError:  # a file system without locks
            self.release()

    @property
    def is_held(self) -> bool:
        """Whether the lock is effective; some file systems have no locks."""
        return self._lock is not None

    def release(self) -> None:
        """Free the folder for others."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


@cache  # several readers look at one folder
def _tell_set_aside(former: Path, folder: Path, why: str) -> None:
    _LOG.warning(
        "%s: files that stood in %s until a command set them aside; "
        "not brought back: %s",
        *(former, folder, why),
    )


class OutFolder:
    """Context manager that claims a folder for the files of one command.

    Entering it checks the folder before any work is done. Files are written in place,
    so the files of a killed process can be read. Former files of the same command are
    replaced only on request, other files never. After an error the written files are
    removed and the former files brought back, unless :meth:`keep` was called.

    Attributes:
        out: as the user gave it; None for files that are not kept.
        path: folder to write to.
    """

    def __init__(
        self,
        out: Path | None,
        *,
        marker: str,
        content: str,
        ours: Collection[str],
        reads: Collection[Path] = (),
        overwrite: bool = False,
    ) -> None:
        """Describe the folder; entering the context claims it.

        Args:
            out: the folder; None for a temporary one.
            marker: file that every folder of its kind holds.
            content: name of such a folder for errors, such as "a run".
            ours: patterns of the names of all files that the command writes.
            reads: files that the command has yet to read; they are not removed.
            overwrite: replace the command's former files.
        """
        self.out = out
        self._keeps = False
        self._former: Path | None = None
        self._marker, self._content, self._ours = marker, content, tuple(ours)
        self._reads, self._overwrite = tuple(reads), overwrite
        self._made: list[Path] = []
        self._lock: FolderLock | None = None
        self.path = Path() if out is None else out

    def __enter__(self) -> Self:
        """Claim the folder.

        Raises:
            UsageError: it is in use, or holds files that may not be replaced.
            EnvironmentFailedError: nothing can be written there.
        """
        if self.out is None:
            self.path = Path(tempfile.mkdtemp(prefix="surefoot-"))
            return self
        self._made = not_there(self.out)
        make_out_folder(self.out, out=self.out)
        self._lock = FolderLock(self.path)
        try:
            if self._lock.is_held:
                self._end_what_was_killed()
            self._check_content()
        except BaseException:
            if self._former is not None:
                self._bring_back(self._former)
            self._release()
            raise
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Release the folder; after an error restore it, unless its files are kept."""
        if self.out is None:
            shutil.rmtree(self.path, ignore_errors=True)
            return
        if isinstance(error, OSError) and error.errno:
            error.filename = error.filename or str(self.path)
        if error is not None and not self._keeps:
            for file in self._files(self.path):
                file.unlink()
            if self._former is not None:
                self._bring_back(self._former)
                self._former = None
            take_away(self._made)
        self._forget_former()
        self._release()

    def settle(self) -> None:
        """Bring back the files that a killed command set aside here, before a reading.

        A warning tells of it. If they cannot be brought back, it tells where they are.
        """
        if not self._formers():
            return
        why = "there are several such folders"
        try:
            lock = FolderLock(self.path)
            try:
                if lock.is_held:
                    self._end_what_was_killed()
                else:
                    why = "without locks nobody knows whether that command still runs"
            finally:
                lock.release()
        except UsageError:
            why = "another command is writing there now"
        except OSError as error:
            why = error.strerror or str(error)
        for former in self._formers():
            _tell_set_aside(former, self.path, why)

    def keep(self) -> None:
        """Make the new files stay whatever happens, and remove the former ones."""
        if not self._keeps:
            self._keeps = True
            self._forget_former()

    def _forget_former(self) -> None:
        if self._former is not None:
            # Rename first: a half-removed folder would be taken for all former files.
            going = self._former.with_name(f"{_GOING}{self._former.name}")
            shutil.rmtree(self._former.rename(going), ignore_errors=True)
        self._former = None

    def _end_what_was_killed(self) -> None:
        """Finish the work of a killed command; the caller holds the lock."""
        for going in self.path.glob(f"{_GOING}{_FORMER}*"):
            shutil.rmtree(going, ignore_errors=True)
        formers = self._formers()
        if len(formers) == 1:  # of several, nobody knows which one is right
            self._bring_back(formers[0])
            _LOG.warning(
                "%s: brought back the files that a killed command had set aside",
                self.path,
            )

    def _formers(self) -> list[Path]:
        """Folders with files set aside by commands that still run or were killed."""
        return sorted(self.path.glob(f"{_FORMER}*"))

    def _bring_back(self, former: Path) -> None:
        """Move the former files back to their place; the new ones were not kept."""
        if (former / self._marker).is_file():  # set aside last: all files are in there
            for file in self._files(self.path):
                file.unlink()
        for file in self._files(former):
            file.replace(self.path / file.name)
        with suppress(OSError):  # another program put a file there
            former.rmdir()

    def _release(self) -> None:
        if self._lock is not None:
            self._lock.release()

    def _check_content(self) -> None:
        if not any(self.path.iterdir()):
            return
        if not (self.path / self._marker).is_file():
            raise UsageError(
                f"--out {self.out}: holds other files than {self._content} of "
                "surefoot; name an empty or new folder"
            )
        if not self._overwrite:
            raise UsageError(
                f"--out {self.out}: holds {self._content} already; name another "
                "folder, or overwrite its files (--overwrite)"
            )
        folder = self.path.resolve()
        read = {path.parent.resolve() / path.name for path in self._reads}
        files = self._files(self.path)
        for file in files:
            if folder / file.name in read:
                raise UsageError(
                    f"--out {self.out}: {file.name} there is what this command reads; "
                    "name another folder, or read a copy"
                )
        self._former = Path(tempfile.mkdtemp(prefix=_FORMER, dir=self.path))
        for file in reversed(files):
            file.replace(self._former / file.name)

    def _files(self, folder: Path) -> list[Path]:
        """Files of this command in a folder, the marker first."""
        names = (self._marker, *self._ours)
        found = dict.fromkeys(file for name in names for file in folder.glob(name))
        return [file for file in found if file.is_file() or file.is_symlink()]
