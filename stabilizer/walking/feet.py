"""States of both feet in a walk: planted, leaving, swinging or landing; and where.

The contact monitor handles a planted foot. From leaving until landed the walk owns the
foot: the monitor would take a foot that is meant to be in the air for one that lost
contact, and one that just touches for one that stands.

    planted -> leaving -> swing -> landing -> planted
                                   |     ^     |
                                   v     |     |
                                  relanding <--+
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum

from surefoot.schemas.arrays import MM_PER_M
from surefoot.schemas.messages import SCHEMA_VERSION
from surefoot.schemas.result import WalkReport
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import WalkStatus
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.dynamics import SolesAndCom
from surefoot.stabilizer.estimation.contact import Anchors, ContactMonitor
from surefoot.stabilizer.estimation.observer import ObservedState
from surefoot.stabilizer.walking.footsteps import SIDES, Foothold
from surefoot.stabilizer.walking.gait import Gait, Phase
from surefoot.stabilizer.walking.step_queue import Move

TOUCH_TICKS_S = 0.003
"""Least time for which a force must last to be a touchdown [s]."""


class WalkState:
    """State of a walk in the present tick, and running sums over the whole walk.

    Attributes:
        phase: present phase.
        step: id of the present or last step; -1 for the one that brings the feet
            together.
        feet: states of left and right foot.
        dcm: estimated DCM, odometry frame [m].
        dcm_reference: reference of the DCM, odometry frame [m].
        zmp_reference: desired ZMP, odometry frame [m].
        footholds: 8 numbers, x, y, z [m] and yaw [rad] of left and right foot, where it
            was set down or is.
        goals: the same; for a foot in the air, the place where it is being set.
        ahead: coming steps within the preview.
        shift: shift of the present step by step adjustment [m].
        done: planned steps that were set down.
        planned: steps of all accepted plans.
        plan_stamp_ns: stamp of the last plan [ns].
        refusal: why the last plan was refused, in words; empty when it was accepted.
        phase_s: time in the phase [s].
        moved: foot that was moved last or is moving; in a walk's first shift the foot
            onto which the weight goes, since the other one is next. None before.
        last_step: largest id of a step that has begun; -1 before the first.
    """

    def __init__(self) -> None:
        """Begin standing, all sums at zero."""
        self.phase = Phase.STAND
        self.phase_s = 0.0
        self.moved: int | None = None
        self.step = self.last_step = -1
        self.feet = [FootState.PLANTED, FootState.PLANTED]
        self.dcm = self.dcm_reference = self.zmp_reference = (0.0, 0.0)
        self.footholds = self.goals = [0.0] * 8
        self.shift = (0.0, 0.0)
        self.done = self.planned = 0
        self.ahead: Sequence[Move] = ()
        self.plan_stamp_ns = 0
        self.refusal = ""
        self._placement_max = 0.0
        self._late: list[float] | None = None
        self._squares = [0.0, 0.0]
        self._largest = (0.0, 0.0)
        self._ticks = 0

    def compare(self, soles: SolesAndCom, gait: Gait) -> tuple[float, float]:
        """Compare the DCM with its reference in this tick.

        Args:
            soles: has the centre of mass and its velocity.
            gait: has the references of DCM and ZMP.

        Returns:
            How far the DCM is off its reference, x and y of the odometry frame [m].
        """
        v, p, omega, (xi_x, xi_y) = soles.v_com, soles.p_com, gait.omega, gait.dcm
        x, y = v.item(0) / omega + p.item(0), v.item(1) / omega + p.item(1)
        self.dcm, self.dcm_reference, self.zmp_reference = (x, y), gait.dcm, gait.zmp
        self._ticks += 1
        ahead, left = x - xi_x, y - xi_y
        squares, (largest_x, largest_y) = self._squares, self._largest
        squares[0] += ahead * ahead
        squares[1] += left * left
        self._largest = (max(largest_x, abs(ahead)), max(largest_y, abs(left)))
        return ahead, left

    def touch(self, *, off: float, late_s: float) -> None:
        """Note a touchdown of the present step.

        Args:
            off: distance of the foot from its goal, the shift included [m].
            late_s: delay against the adjusted time, negative when early [s].
        """
        self.done += self.step >= 0
        self._placement_max = max(self._placement_max, off)
        earliest, latest = self._late or (late_s, late_s)
        self._late = [min(earliest, late_s), max(latest, late_s)]

    def see(self, anchors: Anchors, goals: Sequence[Foothold]) -> None:
        """Note the places of the feet.

        Args:
            anchors: places where the feet were set down, or are.
            goals: the same; for a foot in the air, the place where it is being set.
        """
        (left, right), (yaw_left, yaw_right) = anchors.p, anchors.yaw
        self.footholds = [*left, yaw_left, *right, yaw_right]
        self.goals = [*goals[0], *goals[1]]

    def message(self, *, tick: int, stamp_ns: int) -> WalkStatus:
        """Make the status message of the present tick.

        Args:
            tick: the robot's tick.
            stamp_ns: monotonic clock [ns].
        """
        left, right = self.feet
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
            foothold_left=self.footholds[:4],
            foothold_right=self.footholds[4:],
            goal_left=self.goals[:4],
            goal_right=self.goals[4:],
            ahead=[list(map(float, move.place)) for move in self.ahead]
            if self.phase is not Phase.STAND
            else [],
            shift=list(self.shift),
            dcm=list(self.dcm),
            dcm_reference=list(self.dcm_reference),
            zmp_reference=list(self.zmp_reference),
            plan_stamp_ns=self.plan_stamp_ns,
            refusal=self.refusal,
        )

    def report(self) -> WalkReport:
        """Return the report of the walk so far."""
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


class FootState(StrEnum):
    """What a foot is doing."""

    PLANTED = "planted"
    LEAVING = "leaving"
    """Still carries load, less and less."""
    SWING = "swing"
    LANDING = "landing"
    """On the ground so recently that its forces are those of an impact."""
    RELANDING = "relanding"
    """Bounced, or lost its ground while the other foot stands; it goes straight
    down."""


class Feet:
    """States of both feet; updates contact monitor and anchors.

    Attributes:
        states: of left and right foot.
        since_s: time since each foot's last change of state [s].
        touched: whether each foot touched down in this tick for the first time in its
            step.
        airborne: the foot that is in the air, if any.
        arriving: the foot in the air, else the one that lands, if any.
        landing: which feet feel the impact of a touchdown.
    """

    def __init__(
        self,
        settings: WalkSettings,
        contacts: ContactMonitor,
        anchors: Anchors,
        *,
        weight: float,
        largest_force: float,
        period_s: float,
    ) -> None:
        """Begin with both feet planted.

        Args:
            settings: thresholds and times.
            contacts: is told which feet the walk owns, and whether these stand.
            anchors: is told which feet are planted.
            weight: of the robot [N].
            largest_force: largest normal force to ask of a foot that stands [N].
            period_s: time between two updates [s].
        """
        self._settings = settings
        self._contacts, self._anchors = contacts, anchors
        self._weight, self._largest, self._dt = weight, largest_force, period_s
        self.states = [FootState.PLANTED, FootState.PLANTED]
        self.since_s = [0.0, 0.0]
        self.touched = [False, False]
        self.airborne: int | None = None
        self.arriving: int | None = None
        self.landing = [False, False]
        self._timer = [0.0, 0.0]
        self._landed_s = [0.0, 0.0]

    def is_airborne(self, side: int) -> bool:
        """Whether a foot is in the air, by plan or after a bounce."""
        return self.states[side] in (FootState.SWING, FootState.RELANDING)

    def leave(self, side: int) -> None:
        """Make a foot unload before it is lifted."""
        self._contacts.owned[side] = True
        self._enter(side, FootState.LEAVING)

    def lift(self, side: int) -> None:
        """Make a foot leave the ground."""
        self._contacts.owned[side] = True
        self._contacts.in_contact[side] = False
        self._anchors.planted[side] = False
        self._enter(side, FootState.SWING)

    def give_back(self, side: int) -> None:
        """Return a foot to the contact monitor."""
        self._contacts.take_back(side)
        self._anchors.planted[side] = True
        self._enter(side, FootState.PLANTED)

    def update(self, normals: tuple[float, float], *, may_touch: bool) -> None:
        """Advance by one tick.

        Args:
            normals: measured normal forces, left and right [N].
            may_touch: whether the swing foot is far enough for a force to be a
                touchdown.
        """
        for side in range(2):
            self.since_s[side] += self._dt
            self._landed_s[side] += self._dt
            self.touched[side] = False
            state = self.states[side]
            if state is FootState.SWING or state is FootState.RELANDING:
                if may_touch or state is FootState.RELANDING:
                    self._feel_for_ground(side, normals[side])
            elif state is FootState.LANDING:
                self._land(side, normals)
            elif state is FootState.PLANTED:
                stands = self._contacts.in_contact
                if stands[1 - side] and not stands[side]:  # has lost its ground
                    self._contacts.owned[side] = True
                    self._reland(side)

    def set_down(self, side: int) -> None:
        """Count a foot in the air as touched down, since it cannot feel it."""
        if self.is_airborne(side):
            self._touch(side)

    def settle(self, side: int) -> None:
        """Make a landing foot planted once it has landed for long enough."""
        if (
            self.states[side] is FootState.LANDING
            and self.since_s[side] >= self._settings.landing_s
        ):
            self.give_back(side)

    def share_load(self, left: float, stance: Stance, state: ObservedState) -> None:
        """Write the planned load, and with it the shrinking limit of a leaving foot.

        Args:
            left: planned share of the left foot [1].
            stance: gets the shares.
            state: gets the forces that may be asked for.
        """
        settings, load = self._settings, stance.load
        load[0], load[1] = left, 1.0 - left
        for side, foot in enumerate(self.states):
            if foot is FootState.LEAVING:
                margin = settings.leaving_margin * min(1.0, 4.0 * load[side])
                state.allowed[side] = (load[side] + margin) * self._weight

    def carry_early(self, stance: Stance) -> None:
        """Plan a small load for a foot that landed early."""
        if any(self.landing):
            side = self.landing.index(True)
            early = self._settings.early_share
            stance.load[side], stance.load[1 - side] = early, 1.0 - early

    def _feel_for_ground(self, side: int, normal: float) -> None:
        pressed = normal > self._settings.touchdown_n
        self._timer[side] = self._timer[side] + self._dt if pressed else 0.0
        if self._timer[side] < max(TOUCH_TICKS_S, self._dt) - 0.5 * self._dt:
            return
        self._touch(side)

    def _touch(self, side: int) -> None:
        if self.states[side] is FootState.SWING:
            self._landed_s[side] = 0.0
            self.touched[side] = True
        self._contacts.in_contact[side] = True
        self._enter(side, FootState.LANDING)

    def _land(self, side: int, normals: tuple[float, float]) -> None:
        settings = self._settings
        if self._landed_s[side] >= settings.anchor_s:
            self._anchors.planted[side] = True
        grown = self.since_s[side] / self._contacts.reload_s * self._largest
        self._contacts.allowed[side] = min(max(grown, normals[side]), self._largest)
        off = normals[side] < settings.bounce_n
        self._timer[side] = self._timer[side] + self._dt if off else 0.0
        if (
            self._timer[side] > settings.bounce_s
            and self._contacts.in_contact[1 - side]
        ):
            self._contacts.in_contact[side] = False
            self._reland(side)

    def _reland(self, side: int) -> None:
        self._anchors.planted[side] = False
        self._enter(side, FootState.RELANDING)

    def _enter(self, side: int, state: FootState) -> None:
        self.states[side] = state
        self.since_s[side] = 0.0
        self._timer[side] = 0.0
        self.landing = [state is FootState.LANDING for state in self.states]
        flying = [side for side in range(2) if self.is_airborne(side)]
        self.airborne = flying[0] if flying else None
        self.arriving = self.airborne
        if self.airborne is None and any(self.landing):
            self.arriving = self.landing.index(True)
