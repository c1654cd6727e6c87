"""What a viewer sees: the newest word of everyone."""

from __future__ import annotations

from typing import NamedTuple

from schemas.messages import (
    ImuState,
    JointState,
    RobotStatus,
    StabilizerStatus,
    Truth,
)


class Sight(NamedTuple):
    """The newest message of each channel a viewer needs; None where none has come."""

    joints: JointState | None = None
    imu: ImuState | None = None
    status: RobotStatus | None = None
    stabilizer: StabilizerStatus | None = None
    truth: Truth | None = None


SEEN_CHANNELS = Sight._fields
"""They are called as in the topic table."""
