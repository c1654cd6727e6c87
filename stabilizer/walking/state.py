"""How a walk goes: what is told of every tick, and what it amounts to."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.result import WalkReport
from surefoot.schemas.walk_plan import WalkStatus
from surefoot.stabilizer.estimation.contact import Anchors
from surefoot.stabilizer.walking.feet import FootState
from surefoot.stabilizer.walking.footsteps import SIDES, Foothold
from surefoot.stabilizer.walking.gait import Phase
from surefoot.stabilizer.walking.step_queue import Move

MM_PER_M = 1e3


class WalkState:
    """The present tick of a walk and running sums over all of it.

    Attributes:
        phase: of the walk.
        step: id of the step under way, or taken last; -1 brings the feet together.
        feet: what left and right foot are doing.
        dcm: (2,) estimated divergent component of motion, odometry frame [m].
        dcm_reference: (2,) where it should be [m].
        zmp_reference: (2,) wanted zero-moment point [m].
        footholds: (8,) x, y, z [m] and yaw [rad] of left and right foot: where they
            were set down, or are.
        goals: (8,) the same, of a foot in the air where it is being set.
        ahead: steps to come, as far as the reference looks.
        shift: (2,) of the present step, by step adjustment [m].
        done: steps of plans that were set down.
        planned: steps of all plans that were taken.
        plan_stamp_ns: stamp of the last plan [ns].
        refusal: why it was refused, in words; empty when it was taken.
        phase_s: time in the phase [s].
        moved: the foot moved last, or on its way; None before the first step.
        last_step: largest id of a step that has begun; -1 before the first.
    """

    def __init__(self) -> None:
        """Begin standing, all sums at zero."""
        self.phase = Phase.STAND
        self.phase_s = 0.0
        self.moved: int | None = None
        self.step = self.last_step = -1
        self.feet = [FootState.PLANTED, FootState.PLANTED]
        self.dcm: Array = np.zeros(2)
        self.dcm_reference: Array = np.zeros(2)
        self.zmp_reference: Array = np.zeros(2)
        self.footholds: Array = np.zeros(8)
        self.goals: Array = np.zeros(8)
        self.shift: Array = np.zeros(2)
        self.done = self.planned = 0
        self.ahead: Sequence[Move] = ()
        self.plan_stamp_ns = 0
        self.refusal = ""
        self._placement_max = 0.0
        self._late: list[float] | None = None
        self._squares = [0.0, 0.0]
        self._largest = [0.0, 0.0]
        self._ticks = 0

    def add_error(self) -> None:
        """Take in the DCM's error at a tick of the walk."""
        self._ticks += 1
        for axis in range(2):
            error = abs(self.dcm.item(axis) - self.dcm_reference.item(axis))
            self._squares[axis] += error * error
            self._largest[axis] = max(self._largest[axis], error)

    def touch(self, *, off: float, late_s: float) -> None:
        """Take in a touchdown of the step under way.

        Args:
            off: from where the foot was meant to be set [m].
            late_s: against plan [s].
        """
        self.done += self.step >= 0
        self._placement_max = max(self._placement_max, off)
        earliest, latest = self._late or (late_s, late_s)
        self._late = [min(earliest, late_s), max(latest, late_s)]

    def see(self, anchors: Anchors, goals: Sequence[Foothold]) -> None:
        """Take in where the feet are.

        Args:
            anchors: where they were set down, or are.
            goals: the same, but of a foot in the air where it is being set.
        """
        for side, goal in enumerate(goals):
            start = 4 * side
            self.goals[start : start + 4] = goal
            self.footholds[start : start + 3] = anchors.p[side]
            self.footholds[start + 3] = anchors.yaw[side]

    def message(self, *, tick: int, stamp_ns: int) -> WalkStatus:
        """What to tell everyone of the present tick.

        Args:
            tick: the robot's.
            stamp_ns: monotonic clock [ns].
        """
        left, right = self.feet
        places = self.footholds.tolist(), self.goals.tolist()
        x, y = self.shift.tolist()
        return WalkStatus(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            phase=self.phase,
            phase_s=self.phase_s,
            moved="" if self.moved is None else SIDES[self.moved],
            last_step=self.last_step,
            steps_done=self.done,
            steps_planned=self.planned,
            foot_left=left,
            foot_right=right,
            foothold_left=places[0][:4],
            foothold_right=places[0][4:],
            goal_left=places[1][:4],
            goal_right=places[1][4:],
            ahead=[list(map(float, move.place)) for move in self.ahead]
            if self.phase is not Phase.STAND
            else [],
            shift=[x, y],
            dcm=self.dcm.tolist(),
            dcm_reference=self.dcm_reference.tolist(),
            zmp_reference=self.zmp_reference.tolist(),
            plan_stamp_ns=self.plan_stamp_ns,
            refusal=self.refusal,
        )

    def report(self) -> WalkReport:
        """What the walk amounts to so far."""
        count = max(self._ticks, 1)
        return WalkReport(
            steps_done=self.done,
            steps_planned=self.planned,
            is_over=self.phase is Phase.STAND,
            dcm_error_rms_mm=[MM_PER_M * math.sqrt(x / count) for x in self._squares],
            dcm_error_max_mm=[MM_PER_M * x for x in self._largest],
            placement_error_max_mm=MM_PER_M * self._placement_max,
            touchdown_late_s=self._late or [0.0, 0.0],
            refusal=self.refusal,
        )
