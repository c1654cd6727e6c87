"""Records of ground in files: written, read and refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.schemas.motions import RecordedMotion
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.ground_records import GroundRecord, read_record


def motion_of(path: Path, **keys: object) -> RecordedMotion:
    """Return a motion along x with the record in this file."""
    return RecordedMotion(axis="x", file=str(path), **keys)  # type: ignore[arg-type]


def read(path: Path, content: str | bytes, **keys: object) -> GroundRecord:
    """Write a record and read it."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if path.suffix in (".csv", ".mcap"):
        keys = {"quantity": "acceleration"} | keys
    return read_record(motion_of(path, **keys))


def assert_refused(
    path: Path, content: str | bytes, words: str, **keys: object
) -> None:
    """Check that a record is refused by its name, in a few lines with these words."""
    with pytest.raises(ScenarioError, match=words) as caught:
        read(path, content, **keys)
    assert str(path) in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(path))
