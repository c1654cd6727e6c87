"""Names and contents of the files in the folder of a run."""

from __future__ import annotations

import platform
import shutil
import sys
import tempfile
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

import msgspec

from surefoot.errors import EnvironmentFailedError, UsageError
from surefoot.robot_io.atomic_file import atomic_file
from surefoot.run_plan import RunPlan, make_plan, settings_text
from surefoot.schemas.result import RunResult

RESULT = "result.json"
SETTINGS = "settings.toml"
SCENARIO = "scenario.toml"
RELAY = "relay.toml"
TICKS, CONTROLLER_TICKS = "ticks.mcap", "controller-ticks.mcap"
RECORD = "run.mcap"
QP_FAILURE = "qp-failure.npz"
_PACKAGES = ("surefoot", "eclipse-zenoh", "mujoco", "pin", "piqp", "numpy", "msgspec")
_T = TypeVar("_T", bound=msgspec.Struct)
MARKER = "run.json"
"""Every folder of a run holds this file; a folder without it is not overwritten."""


def make_out_folder(folder: Path, *, out: Path) -> None:
    """Make a folder, with those above it.

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
        """Check the name before any work is done.

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
        """Give itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove what was not kept."""
        shutil.rmtree(self.path, ignore_errors=True)

    def keep(self) -> None:
        """Put the folder in its place; a former run there is replaced."""
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


def write_inputs(folder: Path, plan: RunPlan) -> None:
    """Write what a run depends on: scenario, settings, relay plan, and who ran it.

    With the scenario, the settings and the seed in ``run.json`` the run can be done
    again.
    """
    (folder / SCENARIO).write_text(plan.scenario_text, encoding="utf-8")
    (folder / SETTINGS).write_text(settings_text(plan.settings), encoding="utf-8")
    if plan.relay_path is not None:
        shutil.copyfile(plan.relay_path, folder / RELAY)
    about = {
        "command": sys.argv[1:],
        "scenario": plan.scenario_name,
        "robot": plan.robot_name,
        "servo_profile": plan.robot.file.servo.profile,
        "controller": plan.controller,
        "seed": plan.seed,
        "mode": plan.mode,
        "relay": None if plan.relay_path is None else plan.relay_path.stem,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: _version(name) for name in _PACKAGES},
    }
    (folder / MARKER).write_bytes(msgspec.json.format(msgspec.json.encode(about)))


def write_result(folder: RunDirectory, result: RunResult) -> RunResult:
    """Write the figures of a run and put its folder in place.

    Returns:
        The figures, with the folder's name in them.
    """
    out = None if folder.out is None else str(folder.out)
    result = msgspec.structs.replace(result, out=out)
    write_struct(folder.path / RESULT, result)
    folder.keep()
    return result


def read_run(folder: Path) -> tuple[RunResult, RunPlan]:
    """Figures of a finished run, and what was run.

    Raises:
        UsageError: it is no finished run, or damaged.
    """
    if not folder.is_dir():
        raise UsageError(
            f"{folder}: no such folder; `surefoot run SCENARIO --out {folder}` makes "
            "one"
        )
    for name, why in (
        (MARKER, "not the folder of a run; name what `surefoot run --out` was given"),
        (RESULT, "the run did not finish; its logs (*.log) say why"),
    ):
        if not (folder / name).is_file():
            raise UsageError(f"{folder}: {name} is missing: {why}")
    try:
        result = read_struct(folder / RESULT, RunResult)
        about: dict[str, Any] = msgspec.json.decode((folder / MARKER).read_bytes())
        plan = make_plan(
            folder / SCENARIO,
            robot=about["robot"],
            servo_profile=about["servo_profile"],
            controller=about["controller"],
            settings=folder / SETTINGS,
            seed=about["seed"],
        )
        plan = replace(plan, mode=about["mode"], scenario_name=about["scenario"])
    except (msgspec.DecodeError, KeyError, TypeError) as error:
        raise UsageError(
            f"{folder}: {RESULT} or {MARKER} is damaged, or of another version of "
            f"surefoot ({error}); make the run again"
        ) from error
    return result, plan


def write_struct(path: Path, value: msgspec.Struct) -> None:
    """Write a struct as JSON, whole or not at all."""
    with atomic_file(path) as file:
        file.write(msgspec.json.format(msgspec.json.encode(value)) + b"\n")


def read_struct(path: Path, kind: type[_T]) -> _T:
    """Read what :func:`write_struct` wrote."""
    return msgspec.json.decode(path.read_bytes(), type=kind)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
