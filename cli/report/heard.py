"""What robot and stabilizer said during a run, out of its record."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cli.recording.read_record import Record, read_record
from schemas.arrays import Array

NS_PER_MS = 1e6


@dataclass(frozen=True)
class Heard:
    """Messages of the bus as columns; every ``..._tick`` is the robot's counter.

    Attributes:
        is_cut_off: whether the record has no end.
        told_tick: (n,) of the stabilizer's messages.
        com: (n, 3) estimated centre of mass, stance frame [m].
        com_reference: (n, 3) where it should be, same frame [m].
        F_meas: (n, 12) measured wrenches at left and right sole, sole frames.
        F_id: (n, 12) wanted wrenches.
        in_contact: (n, 2) whether left and right foot stand, as the stabilizer sees it.
        state: (n,) the stabilizer's state, one word.
        tick_ms: (n, 2) median and 99th percentile of its compute time [ms].
        ankle_tick: (m,) of the left ankle's sensor.
        ankle: (m, 6) what it reports: force and moment, sensor frame [N, N m].
        imu_tick: (m,) of the inertial unit.
        imu_quat_xyzw: (m, 4) its own attitude estimate, world from unit.
        answer_tick: (m,) ticks that got a command.
        answer_ms: (m,) from the stamp of the sensors to that of the command [ms].
        mode_tick: (k,) of the robot's status.
        mode: (k,) mode of its command gate.
    """

    is_cut_off: bool
    told_tick: Array
    com: Array
    com_reference: Array
    F_meas: Array
    F_id: Array
    in_contact: Array
    state: list[str]
    tick_ms: Array
    ankle_tick: Array
    ankle: Array
    imu_tick: Array
    imu_quat_xyzw: Array
    answer_tick: Array
    answer_ms: Array
    mode_tick: Array
    mode: list[str]


def read_heard(path: Path) -> Heard:
    """Reads a record.

    Raises:
        UsageError: it cannot be read.
    """
    record = read_record(path)
    told = _messages(record, "stabilizer")
    ankle = _messages(record, "left_ankle_ft")
    imu = _messages(record, "imu")
    status = sorted(_messages(record, "status"), key=lambda message: message["tick"])
    answer_tick, answer_ms = _answers(record)
    return Heard(
        is_cut_off=record.is_cut_off,
        told_tick=_column(told, "tick"),
        com=_rows(told, "com", width=3),
        com_reference=_rows(told, "com_reference", width=3),
        F_meas=_rows(told, "F_meas_left", "F_meas_right", width=12),
        F_id=_rows(told, "F_id_left", "F_id_right", width=12),
        in_contact=_rows(told, "in_contact", width=2),
        state=[message["state"] for message in told],
        tick_ms=np.column_stack(
            (_column(told, "tick_median_ms"), _column(told, "tick_p99_ms"))
        ),
        ankle_tick=_column(ankle, "tick"),
        ankle=_rows(ankle, "force", "moment", width=6),
        imu_tick=_column(imu, "tick"),
        imu_quat_xyzw=_rows(imu, "quat_xyzw", width=4),
        answer_tick=answer_tick,
        answer_ms=answer_ms,
        mode_tick=_column(status, "tick"),
        mode=[message["mode"] for message in status],
    )


def _answers(record: Record) -> tuple[Array, Array]:
    """Ticks with a command, and how long each command took [ms].

    Both stamps are of one clock, since a run has both processes on one host.
    """
    sensed_ns = {m["tick"]: m["stamp_ns"] for m in _messages(record, "joints")}
    answers = [
        (m["tick"], (m["stamp_ns"] - sensed_ns[m["tick"]]) / NS_PER_MS)
        for m in _messages(record, "joint_command")
        if m["tick"] in sensed_ns
    ]
    table = np.array(answers, dtype=np.float64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _messages(record: Record, channel: str) -> list[dict[str, Any]]:
    return record.messages(channel) if channel in record.channels else []


def _column(messages: list[dict[str, Any]], field: str) -> Array:
    return np.array([message[field] for message in messages], dtype=np.float64)


def _rows(messages: list[dict[str, Any]], *fields: str, width: int) -> Array:
    """(n, width) the fields of each message, one behind the other."""
    rows = [
        [number for field in fields for number in message[field]]
        for message in messages
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, width)
