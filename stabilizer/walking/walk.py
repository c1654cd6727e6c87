"""A walk on top of the two QPs: from steps to references, tick by tick.

It writes the stance (centre of mass, base yaw, footholds, planned load), the states of
the feet, and the reference of the swing foot. Without steps it changes nothing.
"""

from __future__ import annotations

import math

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Mat
from surefoot.schemas.settings import WalkSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.control.force_feedback import ForceFeedback
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.dynamics import (
    NORMAL,
    SOLE_ROWS,
    Dynamics,
    SolesAndCom,
)
from surefoot.stabilizer.estimation.contact import Anchors, ContactMonitor
from surefoot.stabilizer.estimation.observer import ObservedState
from surefoot.stabilizer.model import GRAVITY, RobotModel
from surefoot.stabilizer.walking.feet import Feet, FootState, WalkState
from surefoot.stabilizer.walking.footsteps import (
    SIDES,
    Foothold,
    leg_speed_of,
    mean_yaw,
    turned,
)
from surefoot.stabilizer.walking.gait import Gait, HeightReference, Phase
from surefoot.stabilizer.walking.ground import ExpectedGround, GroundMotion
from surefoot.stabilizer.walking.phase_changes import PhaseChanges, is_over
from surefoot.stabilizer.walking.step_adjustment import StepAdjustment
from surefoot.stabilizer.walking.step_queue import Move, StepQueue, nearest_of
from surefoot.stabilizer.walking.swing_foot import SwingFoot

ROLL_ON = 0.5
"""Part of single support after which a force on the swing foot may be a touchdown."""
SENSOR_LOST = "an ankle sensor is lost"
"""Why steps are refused without force sensors."""


class Walk:
    """Takes the steps of a plan.

    Attributes:
        gait: phases and references.
        feet: states of both feet.
        queue: coming steps.
        state: progress of the walk; None before there was a plan.
        swing_tasks: tasks of left and right foot, for the first QP.
        swing_references: references of left and right foot while in the air.
    """

    def __init__(
        self,
        settings: WalkSettings,
        stance: Stance,
        *,
        robot: Robot,
        model: RobotModel,
        contacts: ContactMonitor,
        anchors: Anchors | None,
        largest_force: float,
        height: HeightReference | None,
        servo_lag_s: float,
    ) -> None:
        """Begin standing in the nominal stance.

        Args:
            settings: of walking.
            stance: the reference; written once there are steps.
            robot: content of the robot's files.
            model: of it.
            contacts: contact monitor of the observer.
            anchors: anchors of the estimator; None if it knows no steps: then every
                plan is refused.
            largest_force: to be asked of a foot that stands [N].
            height: makes the centre of mass follow the ground; None if commanded soles
                carry it along.
            servo_lag_s: lag of the joints behind their commands [s].
        """
        self._settings, period_s = settings, robot.period_s
        self._has_odometry = anchors is not None
        anchors = anchors or Anchors(stance.p_sole, stance.yaw_sole)
        self._anchors = anchors
        left, right = stance.p_sole
        middle = 0.5 * (left + right)
        x, y = (stance.com[:2] - middle[:2]).tolist()
        omega = math.sqrt(GRAVITY / stance.com_nominal)
        self.gait = Gait(settings, omega=omega, com_offset=(x, y), period_s=period_s)
        self.feet = Feet(
            settings,
            contacts,
            anchors,
            weight=model.weight,
            largest_force=largest_force,
            period_s=period_s,
        )
        speed = leg_speed_of(model)
        self.queue = StepQueue.of(settings, model=model, stance=stance)
        self.state: WalkState | None = None
        self._told = WalkState()
        self._ground = ExpectedGround(
            settings, half_sizes=model.half_sizes, period_s=period_s
        )
        self._swing = SwingFoot(
            settings,
            self._ground,
            lead_s=settings.lead_s + servo_lag_s,
            leg_speed=speed,
            weight=model.weight,
            period_s=period_s,
        )
        self.swing_tasks = self._swing.tasks
        self.swing_references = self._swing.references
        self._adjustment = StepAdjustment(
            settings,
            nearest=nearest_of(model, settings),
            half_sizes=model.half_sizes[0],
            leg_speed=speed,
            period_s=period_s,
        )
        self._changes = PhaseChanges(
            settings,
            gait=self.gait,
            feet=self.feet,
            contacts=contacts,
            weight=model.weight,
            half_sizes=model.half_sizes[0],
            period_s=period_s,
        )
        self._sole = model.half_sizes[0]
        self._move: Move | None = None
        self._plan: WalkPlan | None = None
        self._begin_tick, self._blind = 0, (False, False)
        self._feels_late = False
        self._standing_base: Mat = np.eye(3)
        self._walking_base: Mat = np.eye(3)
        self._turn: Mat = np.eye(3)
        self._height = height
        self._places: list[Foothold] | None = None
        self._base_yaw: float | None = None

    @property
    def is_walking(self) -> bool:
        """Whether steps are under way."""
        return self.gait.phase is not Phase.STAND

    @property
    def ground_turns(self) -> float:
        """Part of the soles' turns that is the ground's; 1 when standing [1]."""
        return self._ground.turns if self.is_walking else 1.0

    def follow(self, plan: WalkPlan) -> None:
        """Accept or refuse a plan, from the next tick on.

        Args:
            plan: the newest plan; its steps replace those that have not begun.
        """
        if plan is not self._plan:
            self._plan = plan
            self._begin_tick = plan.begin_tick
            told = self.state = self._told
            told.plan_stamp_ns = plan.stamp_ns
            if not self._has_odometry:
                told.refusal = "the estimator knows no steps: it has no anchors"
                return
            if any(self._blind):
                told.refusal = SENSOR_LOST
                return
            feet = self._footholds()
            told.refusal = self.queue.take(plan, feet, walks=self.is_walking)
            told.planned = self.queue.planned

    def end_early(self, *, blind: tuple[bool, bool]) -> None:
        """Take no further steps without ankle sensors; the present one is completed.

        Args:
            blind: whether left and right foot feel nothing. Such a foot, in the air,
                counts as touched down when it is due.
        """
        self._blind = blind
        if any(blind):
            self.queue.drop()
            self._told.refusal, self._told.planned = SENSOR_LOST, self.queue.planned

    def expect_age(self, forces_s: float) -> None:
        """Allow for late force readings.

        Args:
            forces_s: largest age of force readings [s].
        """
        self._feels_late = forces_s > 0.0

    def update(
        self,
        state: ObservedState,
        soles: SolesAndCom,
        stance: Stance,
        *,
        law: GroundMotion,
        tick: int,
        commanded: SolesAndCom | None = None,
    ) -> None:
        """Write the references of this tick.

        Args:
            state: of the robot.
            soles: as measured.
            stance: gets centre of mass, base, footholds and planned load.
            law: has the soles' motion, and the ground's part of it.
            tick: of the robot.
            commanded: soles from which the swing foot's path goes on; the measured ones
                when None.
        """
        if not self.is_walking and not self._begins(state, stance, tick):
            if self.queue.last is not None:
                self._follow_height(stance, state, soles)
            return
        normals = (state.F_meas.item(NORMAL), state.F_meas.item(6 + NORMAL))
        self._places = None
        gait, move = self.gait, self._move
        pause_at = self._changes.pause_at(self._told.dcm, self._footholds)
        lifted = self._changes.update(
            normals,
            self._footholds,
            self._ahead,
            moved=None if move is None else move.side,
            pauses=pause_at is not None,
        )
        if lifted is not None:
            self._lift(lifted, commanded or soles)
            move = self._move
        if not self.is_walking:
            self._stand(stance)
            return
        is_single = gait.phase is Phase.SINGLE
        may_touch = not is_single or gait.t > ROLL_ON * gait.duration_s
        self.feet.update(normals, may_touch=may_touch)
        is_due = is_single and gait.left_s == 0.0
        if move is not None and is_due and self._blind[move.side]:
            self.feet.set_down(move.side)
        self._note_touchdowns(soles)
        self._ground.update(soles, law, state.F_meas, feet=self.feet)
        moved = self._told.moved
        if moved is not None and self.feet.airborne is None:
            self._ground.find_relief(soles, state.F_meas, self._anchors, moved=moved)
        self._told.ahead = self._ahead()
        self.gait.advance(self._footholds(), self._told.ahead, pause_at=pause_at)
        self._adjust(soles)
        self._follow_height(stance, state, soles)
        self._write_stance(stance, state)
        if (airborne := self.feet.airborne) is not None:
            F = state.F_meas[SOLE_ROWS[airborne]]
            is_on_its_way = self.feet.states[airborne] is FootState.SWING
            if is_on_its_way and self._swing.is_caught(airborne, soles, F):
                support = self._footholds()[1 - airborne]
                if is_over(self._told.dcm, support, support, half_sizes=self._sole):
                    self._step_over(airborne, soles)
            self._write_swing(airborne, commanded or soles)
            self.swing_tasks[airborne].compare(soles)
        self._tell()

    def swing_twist(self, dynamics: Dynamics, law: ForceFeedback) -> None:
        """Write the twists of a foot that the wrench law does not know.

        A foot in the air follows its path. A landing foot moves with the ground that
        the other sole shows, until its own sole does.

        Args:
            dynamics: quantities at the present state.
            law: has the twists of the soles, written in place.
        """
        if (airborne := self.feet.airborne) is not None:
            twist = law.r[SOLE_ROWS[airborne]]
            self.swing_tasks[airborne].twist(dynamics, twist)
        else:
            self._ground.carry(dynamics, law)

    def _follow_height(
        self, stance: Stance, state: ObservedState, soles: SolesAndCom
    ) -> None:
        if self._height is not None:
            ground = self._ground
            self._height.follow(
                stance,
                state,
                soles,
                self._anchors,
                under=ground.under,
                middle_over_support=ground.middle_over_support,
            )

    def _footholds(self) -> list[Foothold]:
        """Return the places of the feet; for the swing foot, where it is being set.

        Heights are planned ones: estimated ones drift on moving ground. The places are
        kept until something moves them: the estimator, a lift-off or touchdown, a
        shift.
        """
        if self._places is not None:
            return self._places
        yaws, level = self._anchors.yaw, self._anchors.level
        feet = [
            Foothold(x, y, level[side], yaws[side])
            for side, (x, y, _) in enumerate(self._anchors.p)
        ]
        move = self._move
        if move is not None and self.feet.states[move.side] is FootState.SWING:
            x, y = self._adjustment.shift
            p = move.place
            feet[move.side] = Foothold(p.x + x, p.y + y, p.z, p.yaw)
        self._places = feet
        return feet

    def _ahead(self) -> list[Move]:
        if any(self._blind):  # not even one that brings the feet together
            return []
        return self.queue.ahead(self._footholds(), self._settings.preview_steps + 1)

    def _begins(self, state: ObservedState, stance: Stance, tick: int) -> bool:
        """Begin to walk when it is time for the first step."""
        self._places = None
        if (
            not len(self.queue)
            or tick < self._begin_tick
            or state.is_calibrating
            or not all(state.in_contact)
        ):
            return False
        feet, moves = self._footholds(), self._ahead()
        self._standing_base[:] = turned(-mean_yaw(feet[0].yaw, feet[1].yaw)) @ (
            stance.R_base
        )
        self._base_yaw = None
        self._anchors.by_load = True
        x, y = stance.com[:2].tolist()
        leaving = self.queue.leaving = moves[0].side
        self._told.moved = 1 - leaving
        self.gait.begin_shift(1 - leaving, feet, moves, com=(x, y))
        self._changes.begin()
        return True

    def _lift(self, side: int, soles: SolesAndCom) -> None:
        """Begin the next step."""
        move = self.queue.begin(self._footholds())
        assert move.side == side
        self._move = move
        self.feet.lift(side)
        x, y, _ = soles.p_sole[side].tolist()
        self._adjustment.begin(move, start=(x, y), support=self._footholds()[1 - side])
        level = self._anchors.level
        z = move.place.z
        self._swing.lift(move, soles, rise=z - level[1 - side], climb=z - level[side])
        level[side] = z
        self._places = None
        self.gait.begin_single(move)
        self._told.step, self._told.moved = move.id, side
        self._told.last_step = self.queue.begun

    def _note_touchdowns(self, soles: SolesAndCom) -> None:
        move = self._move
        if move is None:
            return
        side = move.side
        if not self.feet.touched[side]:
            return
        self._places = None
        if self.gait.phase is Phase.SINGLE:
            x, y = self._adjustment.shift
            self._adjustment.stop()
            p = soles.p_sole[side]
            self._told.touch(
                off=math.hypot(p[0] - move.place.x - x, p[1] - move.place.y - y),
                late_s=self.gait.t - self.gait.duration_s,
            )

    def _adjust(self, soles: SolesAndCom) -> None:
        """Compare the DCM with its reference; shift the step if it is off."""
        gait = self.gait
        x, y = self._told.compare(soles, gait)
        move = self._move
        if (
            gait.phase is Phase.SINGLE
            and move is not None
            and self.feet.states[move.side] is FootState.SWING
        ):
            moved = self._adjustment.update(
                (x, y),
                move,
                gait=gait,
                support=self._footholds()[gait.support],
                least_left_s=self._swing.least_left_s,
                foot=self._swing.on_its_way,
            )
            if moved != (0.0, 0.0):
                self.queue.shift_by(*moved)
                self._places = None

    def _write_stance(self, stance: Stance, state: ObservedState) -> None:
        gait, feet = self.gait, self._footholds()
        stance.com[0], stance.com[1] = gait.com
        rate, second = stance.com_velocity, stance.com_acceleration
        rate[0], rate[1] = gait.com_velocity
        second[0], second[1] = gait.com_acceleration
        anchors = self._anchors
        yaws = list(anchors.yaw)
        airborne = self.feet.airborne
        if airborne is not None:
            yaws[airborne] = self._swing.yaw
        if (yaw := mean_yaw(*yaws)) != self._base_yaw:
            self._base_yaw, turn = yaw, self._turn
            turn[0, 0] = turn[1, 1] = math.cos(yaw)
            turn[1, 0] = math.sin(yaw)
            turn[0, 1] = -turn.item(1, 0)
            np.matmul(turn, self._standing_base, out=self._walking_base)
        stance.R_base[:] = self._walking_base
        for p_sole, p in zip(stance.p_sole, anchors.p, strict=True):
            p_sole[0], p_sole[1], p_sole[2] = p
        stance.yaw_sole[:] = anchors.yaw
        self.feet.share_load(gait.left_share(feet), stance, state)
        if gait.phase is Phase.SINGLE:
            self.feet.carry_early(stance)

    def _step_over(self, side: int, soles: SolesAndCom) -> None:
        """Make a caught foot go on higher, and take the time for it.

        If that is too high, the step and the walk end here.
        """
        planned, gait, level = self._move, self.gait, self._anchors.level
        assert planned is not None
        move, needed_s = self._swing.step_over(
            planned,
            soles,
            t=gait.t,
            left_s=gait.left_s,
            rise=level[side] - level[1 - side],
        )
        gait.duration_s = max(gait.duration_s, gait.t + needed_s)
        if move is not planned:
            self._move, self._places = move, None
            x, y, _ = soles.p_sole[side].tolist()
            self._adjustment.begin(
                move, start=(x, y), support=self._footholds()[1 - side]
            )
            self.queue.drop()
            told, rise_m = self._told, self._settings.rise_limit_m
            told.planned = self.queue.planned
            told.refusal = (
                f"the {SIDES[side]} foot met what is in its way up to {rise_m:g} m "
                "(walk.rise_limit_m)"
            )

    def _write_swing(self, side: int, soles: SolesAndCom) -> None:
        """Write the reference of the foot in the air."""
        if self.feet.states[side] is FootState.RELANDING:
            x, y, _ = self._anchors.p[side]
            # Nothing waits for an early foot; felt late, it would hop on and on.
            is_early = self.gait.phase is Phase.SINGLE and self.gait.left_s > 0.0
            self._swing.go_down(
                side,
                soles,
                (x, y),
                yaw=self._anchors.yaw[side],
                since_s=self.feet.since_s[side]
                if is_early and self._feels_late
                else math.inf,
            )
        else:
            self._swing.go_on(
                side,
                soles,
                t=self.gait.t,
                duration_s=self.gait.duration_s,
                shift=self._adjustment.shift,
            )

    def _tell(self) -> None:
        """Update the reported state of the walk."""
        told = self._told
        told.phase, told.phase_s = self.gait.phase, self.gait.t
        told.feet = self.feet.states
        told.shift = self._adjustment.shift
        told.see(self._anchors, self._footholds())

    def _stand(self, stance: Stance) -> None:
        """Keep the stance in which the walk has ended."""
        self._move = self.queue.leaving = None
        self._anchors.by_load = False
        self._tell()
        stance.com_velocity[:] = 0.0
        stance.com_acceleration[:] = 0.0
        stance.load[:] = 0.5, 0.5
