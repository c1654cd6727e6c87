"""The robot a record was made of, from what is attached to it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from cli.errors import UsageError
from cli.recording.attachments import ROBOT_JSON, ROBOT_TOML, ROBOT_URDF
from cli.recording.read_record import Record
from robot_io.robot import Robot, load_robot, make_robot
from schemas.robot_file import RobotFile


@contextmanager
def recorded_robot(record: Record, instead: str | None) -> Iterator[Robot]:
    """The robot with its servo profile, as it was when the record was made.

    Its URDF stands in a folder for the time of the context.

    Args:
        record: with attachments.
        instead: name or path of a robot to use instead; None for the recorded one.

    Raises:
        UsageError: none is attached, or it cannot be read.
        RobotFileError: what is attached contradicts itself.
    """
    if instead is not None:
        yield load_robot(instead)
        return
    files = record.attachments
    if ROBOT_JSON not in files or ROBOT_URDF not in files:
        raise UsageError(
            f"no {ROBOT_JSON} and {ROBOT_URDF} attached to this record; name the robot "
            "with --robot"
        )
    try:
        file = msgspec.json.decode(files[ROBOT_JSON], type=RobotFile)
    except msgspec.DecodeError as error:
        raise UsageError(
            f"the attached {ROBOT_JSON} is none of this version ({error}); name the "
            "robot with --robot"
        ) from error
    with tempfile.TemporaryDirectory(prefix="surefoot-replay-") as name:
        urdf = Path(name) / ROBOT_URDF
        urdf.write_bytes(files[ROBOT_URDF])
        yield make_robot(file, path=Path(name) / ROBOT_TOML, urdf_path=urdf)
