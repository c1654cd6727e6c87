"""Messages that come faster than they are written are lost, and counted so."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.recording import contents
from surefoot.recording.write import McapFile
from surefoot.robot_io.client_side.observer import Sample
from surefoot.robot_io.realtime import StopRequest
from surefoot.schemas.codec import encode
from tests.robot_io.sensor_messages import message

BURSTS, MESSAGES = 6, 2000


class Flood:
    """An observer that receives more messages at once than may wait."""

    robot_is_here = False

    def __init__(self) -> None:
        self.left = BURSTS
        self.tick = 0

    def take(self, *, timeout_s: float = 0.0) -> list[Sample]:
        del timeout_s
        if not self.left:
            return []
        self.left -= 1
        ticks = range(self.tick, self.tick + MESSAGES)
        self.tick += MESSAGES
        return [Sample("imu", encode(message("imu", tick)), 0) for tick in ticks]

    def has_left(self) -> bool:
        return not self.left


def test_more_than_may_wait_is_lost_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    size = len(encode(message("imu", 0)))
    monkeypatch.setattr(contents, "KEPT_BYTES", size * MESSAGES // 2)
    path = tmp_path / "run.mcap"
    with McapFile(
        path,
        channels=["imu", "status"],
        keys={"imu": "i", "status": "s"},
        attachments=[],
        raw=True,
    ) as file:
        contents.record_bus(
            Flood(),  # type: ignore[arg-type]  # what it uses of one
            file,
            on_ready=lambda: None,
            stop=StopRequest(),
        )
    counts = file.counts["imu"]
    assert MESSAGES <= counts.messages < BURSTS * MESSAGES
    assert counts.gaps
    assert counts.messages + counts.missing == counts.last + 1
    assert counts.messages % MESSAGES == 0
