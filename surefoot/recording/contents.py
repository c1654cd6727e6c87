"""The content of a record: messages of the bus, and attached files.

Attached are the robot's files, and the versions of packages and code.
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
from typing import TYPE_CHECKING

import msgspec

from surefoot.errors import UsageError
from surefoot.installation import this_machine
from surefoot.recording.write import Attachment, McapFile
from surefoot.robot_io.realtime import StopRequest, quiet_interpreter
from surefoot.robot_io.robot import EXTENDS, Robot, extended_file
from surefoot.schemas.toml_file import read_toml

if TYPE_CHECKING:
    from surefoot.robot_io.client_side.observer import Observer, Sample

RING_DEPTH = 4096
"""Messages per channel that Zenoh keeps until they are taken.

They last 1.5 s at 3000 ticks a second. Each pins its whole batch of 64 KiB.
"""
KEPT_BYTES = 128 * 2**20
"""Most bytes taken and not yet written; messages beyond are lost and counted so."""
MUCH_BYTES = 4 * 2**20
"""After a larger backlog memory is given back; half a second of a real-time bus."""
TIDY_S = 10.0
"""Period of the garbage collector, which visits all waiting messages [s]."""
SLICE = 500
"""Messages written before more are taken; takes some ten milliseconds."""
PERIOD_S = 0.02
"""Pause that lets messages gather; waking for each would slow other processes [s]."""
LAST_S = 0.3
"""Longest wait for messages that are under way when the robot has gone [s]."""
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
        """Copy all messages from the rings; return whether there were any.

        A message left in a ring would pin the whole batch it came in.
        """
        samples = self._observer.take(timeout_s=timeout_s)
        if self._bytes < KEPT_BYTES:
            self._samples.extend(samples)
            self._bytes += sum(len(sample.data) for sample in samples)
            self._most = max(self._most, self._bytes)
        return bool(samples)

    def write(self) -> bool:
        """Write some messages; return whether any are left."""
        some = list(islice(self._samples, SLICE))
        for sample in some:
            self._samples.popleft()
            self._bytes -= len(sample.data)
        self._file.add(some)
        if not self._samples:
            self._tidy()
        return bool(self._samples)

    def _tidy(self) -> None:
        """Give memory back, when nothing waits."""
        if self._most > MUCH_BYTES or time.monotonic() > self._tidied_s + TIDY_S:
            self._most, self._tidied_s = 0, time.monotonic()
            gc.collect()
            trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
            if trim is not None:  # otherwise glibc keeps freed memory
                trim(0)


def record_bus(
    observer: Observer,
    file: McapFile,
    *,
    on_ready: Callable[[], None],
    stop: StopRequest,
) -> None:
    """Write all messages, until the robot leaves or is away for too long.

    Args:
        observer: connected, with ``status`` as the last of its channels.
        file: where the messages are written.
        on_ready: called after the first ``status``; from then on all are received.
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
                time.sleep(PERIOD_S)  # waking per message would slow the control loop
        while True:
            has_taken = backlog.take(timeout_s=LAST_S)
            has_more = backlog.write()
            if stop.is_set and observer.robot_is_here:
                break
            if not has_taken and not has_more:
                break
        while backlog.write():
            pass


def attachments(robot: Robot, files: Iterable[Path]) -> list[Attachment]:
    """Collect the robot's files, versions, git state, and files named by the user.

    ``robot.toml`` is the robot file as it is; ``robot-below.toml`` is the one that it
    extends, if any; ``robot.json`` is the result of both with the servo profile in use.

    Raises:
        UsageError: a named file cannot be read, or has a name that is taken.
    """
    found = [
        _attachment(ROBOT_TOML, robot.path.read_bytes()),
        _attachment(ROBOT_JSON, msgspec.json.encode(robot.file)),
        _attachment(ROBOT_URDF, robot.urdf_path.read_bytes()),
        _attachment(VERSIONS, msgspec.json.encode(versions())),
    ]
    below = read_toml(robot.path).get(EXTENDS)
    if below is not None:
        data = extended_file(robot.path, str(below)).read_bytes()
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
    """Packages, platform and code that a record was made with."""

    python: str | None = None
    platform: str | None = None
    packages: dict[str, str | None] = {}
    git_commit: str | None = None
    git_changed_files: list[str] = []


def versions() -> Versions:
    """Return the present packages and Python, and this code's commit and changes."""
    return Versions(
        **this_machine(),
        git_commit=_git("rev-parse", "HEAD"),
        git_changed_files=(_git("status", "--porcelain") or "").splitlines(),
    )


def _git(*words: str) -> str | None:
    """Return git's answer about this code; None when it is not in a repository."""
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
    """Return in words what differs from the record; empty when nothing does."""
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
