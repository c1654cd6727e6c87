"""Places for files: claimed before the work begins, and others' left alone."""

from __future__ import annotations

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

try:
    import fcntl
except ImportError:  # no POSIX: two runs into one folder are then not told apart
    fcntl = None  # type: ignore[assignment]


_LOG = logging.getLogger(__name__)
_LONGEST_LINE = 4096
"""Of a file whose first line is looked at [bytes]."""
_FORMER, _GOING = ".former-", ".going"
"""Beginnings of the names of folders with what was there before: until what takes its
place is worth keeping, and while it is removed."""


def make_out_folder(folder: Path, *, out: Path, option: str = "--out") -> None:
    """Make a folder, with those above it, and see that files can be written there.

    Args:
        folder: to be made.
        out: what was asked for, and
        option: by which, for errors.

    Raises:
        UsageError: something on the way is a file, or a link to nothing.
        EnvironmentFailedError: it cannot be made or written to.
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
    """Whether there is a file, which may be replaced.

    Raises:
        UsageError: it may not, or is no file but a folder, a device or a link to one.
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
    """See that a file is not there, or one that the same command wrote.

    Args:
        path: the file.
        signature: what such a file says in its first line.
        overwrite: whether it may be replaced.

    Raises:
        UsageError: it is there, and may not be replaced or is somebody else's.
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
    """Remove again what was made before something went wrong, files and folders.

    Yields:
        To be called with each path before it is made: what is there already stays.
    """
    made: list[Path] = []
    try:
        yield lambda path: made.extend(not_there(path))
    except BaseException:
        take_away(made)
        raise


def not_there(path: Path) -> list[Path]:
    """Return a path and the folders above it, those of them that are yet to be made."""
    return [p for p in (path, *path.parents) if not os.path.lexists(p)]


def take_away(made: Iterable[Path]) -> None:
    """Remove files, and folders as far as nothing else is in them."""
    for path in sorted(made, key=lambda p: len(p.parts), reverse=True):
        with suppress(OSError):  # never made, or others' files are in it
            path.rmdir() if path.is_dir() else path.unlink()


def write_whole(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all."""
    with atomic_file(path) as file:
        file.write(data)


def write_json(path: Path, value: Any) -> None:
    """Write a struct, or built-in types, as indented JSON, whole or not at all."""
    write_whole(path, msgspec.json.format(json_bytes(value)) + b"\n")


def json_bytes(value: Any) -> bytes:
    """A struct, or built-in types, as JSON, whatever the names of files in it."""
    try:
        return msgspec.json.encode(value)
    except UnicodeEncodeError:
        return msgspec.json.encode(_all_printable(msgspec.to_builtins(value)))


def printable(name: str) -> str:
    """A name of the file system as text that JSON and pages can hold."""
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
    """Open a file that takes its name once it is complete.

    Raises:
        UsageError: another command took the name meanwhile.
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
    """Keeps other commands out of a folder until it is released, or this one ends."""

    def __init__(self, folder: Path) -> None:
        """Lock the folder itself: the system forgets that when this process ends.

        Raises:
            UsageError: another command has it.
        """
        self._lock: int | None = None
        if fcntl is None:
            return
        self._lock = os.open(folder, os.O_RDONLY)
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
        """Whether it keeps others out: some file systems have no locks."""
        return self._lock is not None

    def release(self) -> None:
        """Let others have the folder."""
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
    """Claims a folder for the files of one command. A context manager.

    Everything that can be wrong with it is found when it is entered, before any work is
    done. Files are written in place, so what a killed process leaves is there to be
    read. Files of ours that stand there from before are replaced only on request,
    anybody else's never. An error takes away what was written and brings back what was
    there, unless what was written is worth keeping (:meth:`keep`).

    Attributes:
        out: as the user gave it; None for files that nobody keeps.
        path: where to write.
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
        """Say what is to be claimed.

        Args:
            out: the folder; None for a temporary one.
            marker: file that every folder of its kind holds.
            content: what such a folder is, for errors, such as "a run".
            ours: patterns of the names of all files that the command writes.
            reads: files that the command has yet to read, and so does not remove.
            overwrite: replace our own files of before.
        """
        self.out = out
        self._keeps = False
        self._former: Path | None = None
        self._marker, self._content, self._ours = marker, content, tuple(ours)
        self._reads, self._overwrite = tuple(reads), overwrite
        self._is_new = False
        self._lock: FolderLock | None = None
        self.path = Path() if out is None else out

    def __enter__(self) -> Self:
        """Claim the folder.

        Raises:
            UsageError: it is in use, or holds something.
            EnvironmentFailedError: nothing can be written there.
        """
        if self.out is None:
            self.path = Path(tempfile.mkdtemp(prefix="surefoot-"))
            return self
        self._is_new = not self.out.exists()
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
        """Release the folder; without anything worth keeping it is as before."""
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
            if self._is_new:
                with suppress(OSError):  # somebody else put something there
                    self.path.rmdir()
        self._forget_former()
        self._release()

    def settle(self) -> None:
        """Bring back what a killed command set aside here, for who is about to read.

        It is said; where it cannot be done, it is said where the files are.
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
        """Have the files stay from now on whatever happens, and those of before go."""
        if not self._keeps:
            self._keeps = True
            self._forget_former()

    def _forget_former(self) -> None:
        if self._former is not None:
            # Under another name first: half of it would be taken for all there was.
            going = self._former.with_name(f"{_GOING}{self._former.name}")
            shutil.rmtree(self._former.rename(going), ignore_errors=True)
        self._former = None

    def _end_what_was_killed(self) -> None:
        """Do what a command that was killed had no time for; nobody else is here."""
        for going in self.path.glob(f"{_GOING}{_FORMER}*"):
            shutil.rmtree(going, ignore_errors=True)
        formers = self._formers()
        if len(formers) == 1:  # of several, nobody knows which is to stand there
            self._bring_back(formers[0])
            _LOG.warning(
                "%s: brought back the files that a killed command had set aside",
                self.path,
            )

    def _formers(self) -> list[Path]:
        """Folders with what commands set aside: they still run, or were killed."""
        return sorted(self.path.glob(f"{_FORMER}*"))

    def _bring_back(self, former: Path) -> None:
        """Move what was there before to its place; what stands there was not kept."""
        if (former / self._marker).is_file():  # the last to go: all of it is in there
            for file in self._files(self.path):
                file.unlink()
        for file in self._files(former):
            file.replace(self.path / file.name)
        with suppress(OSError):  # somebody else put something there
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
        """Files of ours in a folder, the marker first."""
        names = (self._marker, *self._ours)
        found = dict.fromkeys(file for name in names for file in folder.glob(name))
        return [file for file in found if file.is_file() or file.is_symlink()]
