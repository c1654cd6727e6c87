"""What goes into a record: messages of the bus as they come, and files beside them.

Those are the robot's files, and what runs here: versions and code.
"""

from __future__ import annotations

import ctypes
import gc
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from surefoot.errors import UsageError
from surefoot.installation import this_machine
from surefoot.robot_io.realtime import StopRequest, quiet_interpreter
from surefoot.robot_io.robot import EXTENDS, Robot
from surefoot.schemas.toml_file import read_toml

if TYPE_CHECKING:
    from surefoot.recording.write import McapFile
    from surefoot.robot_io.client_side.observer import Observer, Sample

RING_DEPTH = 4096
"""Messages that Zenoh keeps per channel until they are taken, each with all of the
batch of 64 KiB it came in: a second and a half at 3000 ticks a second."""
KEPT_BYTES = 128 * 2**20
"""Taken and not yet written; with more, what comes is lost, which the record tells."""
MUCH_BYTES = 4 * 2**20
"""So much is half a second of a bus in real time; after more memory is given back."""
TIDY_S = 10.0
"""The collector, which would go through all that waits, has its turn so often [s]."""
SLICE = 500
"""Messages written before the rings are emptied again: some ten milliseconds."""
PERIOD_S = 0.02
"""Many messages at a time cost the other processes less than each for itself."""
LAST_S = 0.3
"""Once the robot is gone, what is still on its way may take so long [s]."""
ROBOT_TOML, ROBOT_BELOW, ROBOT_JSON = "robot.toml", "robot-below.toml", "robot.json"
ROBOT_URDF, VERSIONS = "robot.urdf", "versions.json"
_GIT_S = 5.0
_MEDIA = {
    ".toml": "application/toml",
    ".json": "application/json",
    ".urdf": "application/xml",
}


class _Backlog:
    """Messages between bus and disk: taken at once, written when there is time."""

    def __init__(self, observer: Observer, file: McapFile) -> None:
        self._observer, self._file = observer, file
        self._samples: deque[Sample] = deque()
        self._bytes = self._most = 0
        self._tidied_s = time.monotonic()

    def take(self, *, timeout_s: float = 0.0) -> bool:
        """Copy what the rings hold; whether there was anything.

        Always all of it: what waits there pins the batches that it came in.
        """
        samples = self._observer.take(timeout_s=timeout_s)
        if self._bytes < KEPT_BYTES:
            self._samples.extend(samples)
            self._bytes += sum(len(sample.data) for sample in samples)
            self._most = max(self._most, self._bytes)
        return bool(samples)

    def write(self) -> bool:
        """Write some; whether anything is left."""
        some = list(islice(self._samples, SLICE))
        for sample in some:
            self._samples.popleft()
            self._bytes -= len(sample.data)
        self._file.add(some)
        if not self._samples:
            self._tidy()
        return bool(self._samples)

    def _tidy(self) -> None:
        """Give memory back, once nothing waits."""
        if self._most > MUCH_BYTES or time.monotonic() > self._tidied_s + TIDY_S:
            self._most, self._tidied_s = 0, time.monotonic()
            gc.collect()
            trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
            if trim is not None:  # glibc keeps what is freed for what comes
                trim(0)


def record_bus(
    observer: Observer,
    file: McapFile,
    *,
    on_ready: Callable[[], None],
    stop: StopRequest,
) -> None:
    """Write everything that comes, until the robot ends or is away for too long.

    Args:
        observer: connected, ``status`` the last of its channels.
        file: gets the messages.
        on_ready: called at the first ``status``: whoever receives it receives all.
        stop: ends the recording in order.

    Raises:
        OSError: the file cannot be written.
    """
    backlog = _Backlog(observer, file)
    is_ready = False
    with stop.on_signals(), quiet_interpreter():
        while not observer.has_left() and not stop.is_set:
            backlog.take()
            has_more = backlog.write()
            if not is_ready and file.counts["status"].messages:
                is_ready = True
                on_ready()
            if not has_more:
                time.sleep(PERIOD_S)  # gathers: waking per message would cost the loop
        while True:
            has_taken = backlog.take(timeout_s=LAST_S)
            has_more = backlog.write()
            if stop.is_set and observer.robot_is_here:
                break
            if not has_taken and not has_more:
                break
        while backlog.write():
            pass


class Attachment(NamedTuple):
    """A file that goes into the record."""

    name: str
    media_type: str
    data: bytes


def attachments(robot: Robot, files: Iterable[Path]) -> list[Attachment]:
    """Collect the robot's files, versions, git state, and files named by the user.

    ``robot.toml`` is the robot file as it stands, ``robot-below.toml`` the one it
    extends if any, ``robot.json`` both together with the servo profile in use.

    Raises:
        UsageError: a named file cannot be read, or bears the name of another.
    """
    found = [
        _attachment(ROBOT_TOML, robot.path.read_bytes()),
        _attachment(ROBOT_JSON, msgspec.json.encode(robot.file)),
        _attachment(ROBOT_URDF, robot.urdf_path.read_bytes()),
        _attachment(VERSIONS, msgspec.json.encode(versions())),
    ]
    below = read_toml(robot.path).get(EXTENDS)
    if below is not None:
        data = (robot.path.parent / str(below)).read_bytes()
        found.append(_attachment(ROBOT_BELOW, data))
    for path in files:
        if path.name in {entry.name for entry in found}:
            raise UsageError(f"--attach {path}: the record has a {path.name} already")
        try:
            found.append(_attachment(path.name, path.read_bytes()))
        except OSError as error:
            raise UsageError(f"--attach {path}: {error.strerror}") from error
    return found


def _attachment(name: str, data: bytes) -> Attachment:
    media = _MEDIA.get(Path(name).suffix, "application/octet-stream")
    return Attachment(name, media, data)


class Versions(msgspec.Struct, kw_only=True):
    """What a record was made with."""

    python: str | None = None
    platform: str | None = None
    packages: dict[str, str | None] = {}
    git_commit: str | None = None
    git_changed_files: list[str] = []


def versions() -> Versions:
    """What runs here: packages, Python, commit and changed files of our own code."""
    return Versions(
        **this_machine(),
        git_commit=_git("rev-parse", "HEAD"),
        git_changed_files=(_git("status", "--porcelain") or "").splitlines(),
    )


def _git(*words: str) -> str | None:
    """What git says of our own code; None where it is installed without git."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *words],
            capture_output=True,
            text=True,
            timeout=_GIT_S,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def version_notes(recorded: bytes | None, present: Versions) -> list[str]:
    """What is other than it was, in words; nothing when all is the same."""
    if recorded is None:
        return ["the record does not say which versions it was made with"]
    try:
        then = msgspec.json.decode(recorded, type=Versions)
    except (ValueError, RecursionError) as error:
        return [f"the attached {VERSIONS} cannot be read ({error})"]
    notes = [
        f"{name}: recorded with {before}, now {now}"
        for name, before, now in (
            ("python", then.python, present.python),
            ("platform", then.platform, present.platform),
        )
        if before != now
    ]
    notes += [
        f"{name}: recorded with {then.packages.get(name)}, now {version}"
        for name, version in present.packages.items()
        if then.packages.get(name) != version
    ]
    return notes + _code_notes(then, present)


def _code_notes(then: Versions, present: Versions) -> list[str]:
    before, now = then.git_commit, present.git_commit
    notes = []
    if before != now:
        notes.append(f"code: recorded at commit {_short(before)}, now {_short(now)}")
    for when, about in (("when recorded", then), ("now", present)):
        changed = about.git_changed_files
        if changed:
            notes.append(f"code: files not committed {when}: {len(changed)}")
    return notes


def _short(commit: str | None) -> str:
    return "unknown" if commit is None else commit[:12]
