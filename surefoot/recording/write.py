"""Writes bus messages to an MCAP file."""

from __future__ import annotations

import errno
import json
import platform
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import msgspec
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from surefoot.errors import UsageError
from surefoot.robot_io.bus.stop_request import StopRequest
from surefoot.robot_io.client_side.observer import Observer, Sample
from surefoot.robot_io.robot import EXTENDS, Robot
from surefoot.schemas.json_schema import json_schema
from surefoot.schemas.toml_file import read_toml
from surefoot.schemas.topics import TICK_SENSORS, topic

CHUNK_BYTES = 128 * 1024
"""Small: what a crash can cost is the chunk that is being filled."""
KEPT_FREE_BYTES = 64 * 2**20
"""Left on the disk, so that a record never takes the room of a run's own files."""
MSGPACK = "msgpack"
COUNTS = "surefoot/counts"
"""Name of the metadata with what was counted, one entry a channel."""
_UNITS = "SI units and radians; wrenches and orientations as the schema says"
_SEQUENCE_MASK = 2**32 - 1
_COMMANDS = "joint_command"
ROBOT_TOML, ROBOT_BELOW, ROBOT_JSON = "robot.toml", "robot-below.toml", "robot.json"
ROBOT_URDF, VERSIONS = "robot.urdf", "versions.json"
_PACKAGES = ("surefoot", "eclipse-zenoh", "mujoco", "pin", "piqp", "numpy", "msgpack")
_GIT_S = 5.0
_MEDIA = {
    ".toml": "application/toml",
    ".json": "application/json",
    ".urdf": "application/xml",
}
RING_DEPTH = 16384
"""Messages kept per channel while we write: five seconds at 3000 ticks a second."""
PERIOD_S = 0.02
"""Many messages at a time cost the other processes less than each for itself."""
LAST_S = 0.3
"""Once the robot is gone, what is still on its way may take so long [s]."""


class ChannelCount(msgspec.Struct, kw_only=True):
    """What came on a channel.

    ``first`` and ``last`` are ticks; for commands they are sequence numbers, and
    for channels that do not speak every tick nothing can be known to be missing.
    """

    channel: str
    counted_by: str
    """``tick``, ``sequence``, or empty for a channel without a fixed rate."""
    messages: int = 0
    first: int | None = None
    last: int | None = None
    missing: int = 0
    """Numbers passed over between the first message and the last."""
    gaps: int = 0
    """Places where some are missing."""
    commander: str = ""
    """Who sent the latest command."""
    restarts: int = 0
    """Times the count did not go on but began anew: another robot or commander."""

    def add(self, number: int, *, is_new_sender: bool = False) -> None:
        """Count one message.

        Args:
            number: its tick, or its sequence number.
            is_new_sender: it cannot be compared with the one before.
        """
        self.messages += 1
        last, self.last = self.last, number
        if last is None:
            self.first = number
        elif not self.counted_by:
            return
        elif is_new_sender or number <= last:
            self.restarts += 1
        elif number > last + 1:
            self.missing += number - last - 1
            self.gaps += 1


def new_count(channel: str) -> ChannelCount:
    """A count of a channel by what its messages are numbered with."""
    if channel == _COMMANDS:
        return ChannelCount(channel=channel, counted_by="sequence")
    by = "tick" if channel in TICK_SENSORS else ""
    return ChannelCount(channel=channel, counted_by=by)


def count_message(count: ChannelCount, message: dict[str, Any]) -> None:
    """Count a decoded message of the channel.

    Raises:
        KeyError: it lacks what it is counted by.
    """
    if count.channel != _COMMANDS:
        count.add(message["tick"])
        return
    is_new = message["commander"] != count.commander
    count.commander = message["commander"]
    count.add(message["sequence"], is_new_sender=is_new)


class Attachment(NamedTuple):
    """A file that goes into the record."""

    name: str
    media_type: str
    data: bytes


class McapFile:
    """An MCAP file that takes its name once it is complete.

    A context manager. Until it is left without an error the file is called
    ``NAME.partial``; whatever cuts it short leaves that file with all chunks written
    so far.

    Attributes:
        path: final name.
        partial: name meanwhile.
        counts: of each channel.
        unreadable: messages that could not be read, by channel; they are left out.
    """

    def __init__(
        self,
        path: Path,
        *,
        channels: Iterable[str],
        keys: dict[str, str],
        attachments: Iterable[Attachment],
        raw: bool,
    ) -> None:
        """Create the file and write schemas, channels and attachments.

        Args:
            path: where it goes; an older file there is replaced at the end.
            channels: names from the topic table.
            keys: channel name to bus key.
            attachments: what the messages alone do not tell.
            raw: write the bytes of the bus, not JSON.

        Raises:
            OSError: it cannot be written; the message says what is left.
        """
        self.path = path
        self.partial = path.with_name(path.name + ".partial")
        self.counts = {name: new_count(name) for name in channels}
        self.unreadable = dict.fromkeys(self.counts, 0)
        self._raw = raw
        try:
            self._file = self.partial.open("wb")
            self._writer = Writer(
                self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4
            )
            self._writer.start(profile="", library="surefoot")
            self._ids = {name: self._declare(name, keys[name]) for name in self.counts}
            for entry in attachments:
                self._writer.add_attachment(
                    0, 0, entry.name, entry.media_type, entry.data
                )
            self._file.flush()
        except OSError as error:
            raise self._explained(error) from error

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Complete the file, unless an error has cut it short.

        Raises:
            OSError: it cannot be completed.
        """
        try:
            if error is None:
                counts = {
                    name: msgspec.json.encode(count).decode()
                    for name, count in self.counts.items()
                }
                self._writer.add_metadata(COUNTS, counts)
                # mcap gives this method no types.
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.flush()
            self._file.close()
            if error is None:
                self.partial.replace(self.path)
        except OSError as failure:
            # What one error has cut short is told by that error.
            if error is None:
                raise self._explained(failure) from failure

    def add(self, samples: Iterable[Sample]) -> None:
        """Write messages, at the time their sender stamped them.

        Raises:
            OSError: the disk is full, or the like.
        """
        try:
            self._check_room()
            for sample in samples:
                self._add(sample)
            self._file.flush()
        except OSError as error:
            raise self._explained(error) from error

    def _add(self, sample: Sample) -> None:
        name = sample.channel
        try:
            message: dict[str, Any] = msgspec.msgpack.decode(sample.data)
            tick, stamp_ns = message["tick"], message["stamp_ns"]
            data = sample.data if self._raw else msgspec.json.encode(message)
            count_message(self.counts[name], message)
        except (msgspec.DecodeError, KeyError, TypeError, ValueError):
            self.unreadable[name] += 1
            return
        self._writer.add_message(
            self._ids[name],
            log_time=stamp_ns,
            publish_time=stamp_ns,
            data=data,
            sequence=tick & _SEQUENCE_MASK,
        )

    def _check_room(self) -> None:
        if shutil.disk_usage(self.partial.parent).free < KEPT_FREE_BYTES:
            raise OSError(
                errno.ENOSPC,
                f"the disk is full but for {KEPT_FREE_BYTES >> 20} MiB, which are left "
                "to others; make room, or record elsewhere",
            )

    def _declare(self, name: str, key: str) -> int:
        entry = topic(name)
        schema = json_schema(entry.message)
        schema_id = self._writer.register_schema(
            name=f"surefoot.{entry.message.__name__}",
            encoding=SchemaEncoding.JSONSchema,
            data=json.dumps(schema).encode(),
        )
        return self._writer.register_channel(
            topic=f"/{name}",
            message_encoding=MSGPACK if self._raw else MessageEncoding.JSON,
            schema_id=schema_id,
            metadata={
                "key": key,
                "direction": entry.direction.value,
                "rate": entry.rate,
                "description": entry.description,
                "units": _UNITS,
            },
        )

    def _explained(self, error: OSError) -> OSError:
        reason = error.strerror or str(error)
        left = (
            f"; what was written so far is in {self.partial} "
            "(surefoot log info tells how much)"
            if self.partial.exists()
            else ""
        )
        return OSError(f"cannot record to {self.path}: {reason}{left}")


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


def versions() -> dict[str, object]:
    """What runs here: packages, Python, commit and changed files of our own code."""
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: _version(name) for name in _PACKAGES},
        "git_commit": _git("rev-parse", "HEAD"),
        "git_changed_files": (_git("status", "--porcelain") or "").splitlines(),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


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


def record_bus(
    observer: Observer,
    file: McapFile,
    *,
    on_ready: Callable[[], None],
    stop: StopRequest,
) -> None:
    """Write everything that comes.

    Args:
        observer: connected, ``status`` the last of its channels.
        file: gets the messages.
        on_ready: called at the first ``status``: whoever receives it receives all.
        stop: ends the recording in order.

    Raises:
        OSError: the file cannot be written.
    """
    is_ready = False
    with stop.on_signals():
        while observer.robot_is_here and not stop.is_set:
            samples = observer.take()
            file.add(samples)
            if not is_ready and file.counts["status"].messages:
                is_ready = True
                on_ready()
            time.sleep(PERIOD_S)  # gathers: waking per message would cost the loop
        while samples := observer.take(timeout_s=LAST_S):
            file.add(samples)
            if stop.is_set and observer.robot_is_here:
                break
