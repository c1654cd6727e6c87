"""Keeps the runs of a study in a folder, so that it can go on after any end."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import msgspec

from surefoot.errors import UsageError
from surefoot.out_folder import make_out_folder
from surefoot.robot_io.atomic_file import atomic_file
from surefoot.studies.cell import Row, Task
from surefoot.studies.fingerprint import about_code

STUDY, RUNS = "study.json", "runs.jsonl"


class StudyStore:
    """A folder of finished runs, one JSON line each.

    A run is written when it is done and never changed; a line that was cut off when
    the process was killed is left out, and that run is done again.

    Attributes:
        rows: finished runs by key.
    """

    def __init__(self, folder: Path, *, about: dict[str, Any]) -> None:
        """Look at a former study, or name a new one; :meth:`begin` writes.

        Args:
            folder: where it is, or will be.
            about: what all runs share, such as overrides; code and packages are
                added.

        Raises:
            UsageError: the folder holds runs of other code or settings, or something
                else altogether.
        """
        self.rows: dict[str, Row] = {}
        self._folder = folder
        self._path = folder / RUNS
        self._file: BinaryIO | None = None
        about = {**about, **about_code()}
        self.about = about
        marker = folder / STUDY
        if marker.is_file():
            self._compare(msgspec.json.decode(marker.read_bytes()), folder)
        elif folder.is_dir() and any(folder.iterdir()):
            raise UsageError(f"{folder}: not empty and no study; name another folder")
        self.rows = {row["key"]: row for row in read_rows(folder)}

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def begin(self) -> None:
        """Make the folder, and open the file of runs without a line that was cut off.

        Raises:
            UsageError: something on the way to the folder is a file.
            EnvironmentFailedError: nothing can be written there.
        """
        if self._file is not None:
            return
        make_out_folder(self._folder, out=self._folder)
        with atomic_file(self._folder / STUDY) as file:
            file.write(msgspec.json.format(msgspec.json.encode(self.about)) + b"\n")
        with atomic_file(self._path) as file:
            for row in self.rows.values():
                file.write(msgspec.json.encode(row) + b"\n")
        self._file = self._path.open("ab")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def add(self, row: Row) -> None:
        """Keep a finished run."""
        self.begin()
        assert self._file is not None
        self._file.write(msgspec.json.encode(row) + b"\n")
        self._file.flush()
        self.rows[row["key"]] = row

    def check(self, task: Task) -> None:
        """See that a kept run of a cell, if there is one, is the run that is meant.

        Args:
            task: what is to be run, with scenario, robot and settings as they are.

        Raises:
            UsageError: it was made with others of the same name.
        """
        row = self.rows.get(task.cell.key)
        if row is not None and row["inputs"] != task.inputs:
            raise UsageError(
                f"{self._path}: holds a run of {task.cell.case} from before its "
                "scenario, robot or settings were changed; runs of both would be "
                "mixed. Name another folder, or remove this one"
            )

    def _compare(self, former: dict[str, Any], folder: Path) -> None:
        differing = [
            name
            for name in {**self.about, **former}
            if self.about.get(name) != former.get(name)
        ]
        if differing:
            raise UsageError(
                f"{folder}: holds runs of another study (differing: "
                f"{', '.join(sorted(differing))}); runs of both would be mixed. Name "
                "another folder, or remove this one"
            )


def read_rows(folder: Path) -> Iterable[Row]:
    """Read the finished runs of a folder, without a line that was cut off."""
    path = folder / RUNS
    if not path.is_file():
        return
    for line in path.read_bytes().splitlines():
        try:
            row: Row = msgspec.json.decode(line)
        except msgspec.DecodeError:
            continue
        yield row
