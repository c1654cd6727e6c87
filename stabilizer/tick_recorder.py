"""Hands on what the controller knows of every tick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.ticks.recorder import TickRecorder, TickSink
from surefoot.schemas.arrays import Array
from surefoot.schemas.signals import MISSING, QP_WORDS, WALK_SIGNALS, lay_out
from surefoot.stabilizer.control.controller import ControllerOutput
from surefoot.stabilizer.walking.feet import FootState
from surefoot.stabilizer.walking.gait import Phase
from surefoot.stabilizer.walking.state import WalkState

_ARRAYS = (
    *("F_id", "F_meas", "base_pose", "base_twist"),
    *("com", "com_reference", "r", "v_joint"),
)
_PHASES, _FOOT_STATES = list(Phase), list(FootState)
_NUMBERS = ("in_contact", "wrench_qp", "motion_qp", "controller_ms")
_MS_PER_NS = 1e-6
_OTHER = len(QP_WORDS) - 1
_QP_NUMBERS = {word: number for number, word in enumerate(QP_WORDS)}
_NO_CONTACTS = (MISSING, MISSING)


class ControllerRecorder:
    """Takes in a controller's answers; what it does not tell is left out."""

    def __init__(
        self,
        sink: TickSink,
        *,
        joints: Sequence[str],
        period_s: float,
        walks: bool = False,
    ) -> None:
        """Begin.

        Args:
            sink: gets the ticks.
            joints: names, in the order of the robot file.
            period_s: of the robot [s].
            walks: whether to keep what only a walk has.
        """
        names = (*_ARRAYS, *WALK_SIGNALS) if walks else _ARRAYS
        self._walks = walks
        arrays = [lay_out(name, joints=joints) for name in names]
        others = [lay_out(name, joints=joints) for name in _NUMBERS]
        clock = [lay_out(name, joints=joints) for name in ("tick", "time_s")]
        self._recorder = TickRecorder([*clock, *arrays, *others], sink)
        self._nothing = [np.full(len(x.labels), x.missing) for x in arrays]
        self._period_s = period_s
        self._time_s = np.zeros(1)
        self._numbers = np.zeros(sum(len(x.labels) for x in others))

    def add(self, tick: int, output: ControllerOutput, *, duration_ns: int) -> None:
        """Take in an answer.

        Args:
            tick: the robot's counter that it answers.
            output: the answer; copied.
            duration_ns: time it took [ns].
        """
        self._time_s[0] = tick * self._period_s
        left, right = output.in_contact or _NO_CONTACTS
        self._numbers[:] = (
            left,
            right,
            _QP_NUMBERS.get(output.wrench_qp, _OTHER),
            _QP_NUMBERS.get(output.motion_qp, _OTHER),
            duration_ns * _MS_PER_NS,
        )
        told: tuple[Array | None, ...] = (
            output.F_id,
            output.F_meas,
            output.base_pose,
            output.base_twist,
            output.com,
            output.com_reference,
            output.r,
            output.v_joint,
        )
        if self._walks:
            told += _of_walk(output.walk)
        parts = [
            nothing if values is None else values
            for values, nothing in zip(told, self._nothing, strict=True)
        ]
        self._recorder.add(tick, (self._time_s, *parts, self._numbers))


def _of_walk(walk: WalkState | None) -> tuple[Array | None, ...]:
    """What a walk adds."""
    if walk is None:
        return (None,) * len(WALK_SIGNALS)
    phase = _PHASES.index(walk.phase)
    left, right = (_FOOT_STATES.index(state) for state in walk.feet)
    return (
        walk.dcm,
        walk.dcm_reference,
        walk.zmp_reference,
        walk.footholds,
        walk.goals,
        np.array((phase,)),
        np.array((left, right)),
    )


def recorder_to(
    sink: TickSink | None, robot: Robot, *, walks: bool = False
) -> ControllerRecorder | None:
    """A recorder for a robot's controller; None without a sink.

    Args:
        sink: gets the ticks.
        robot: names the joints.
        walks: whether to keep what only a walk has.
    """
    if sink is None:
        return None
    return ControllerRecorder(
        sink, joints=robot.joint_names, period_s=robot.period_s, walks=walks
    )
