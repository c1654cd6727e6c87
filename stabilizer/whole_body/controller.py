"""The whole-body stabilizer: sensors in, joint command out, nothing else.

Data flows one way: snapshot -> observer -> first QP (TSID) -> wrench law -> second QP
(DIK) -> integration. No clock, no I/O, no randomness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.control.dik import Dik
from surefoot.stabilizer.control.drives import DriveInverse, fastest_mode
from surefoot.stabilizer.control.force_feedback import ForceFeedback
from surefoot.stabilizer.control.reference import Approach
from surefoot.stabilizer.control.tasks import Task, standing_tasks
from surefoot.stabilizer.control.tsid import Tsid
from surefoot.stabilizer.controller import (
    CATCH_UP,
    BalanceController,
    ControllerOutput,
)
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.estimation.observer import (
    ObservedState,
    Observer,
    ReadingAges,
    StateEstimator,
)
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, RobotModel
from surefoot.stabilizer.qp import PiqpSolver, QpSolver, QpStatus
from surefoot.stabilizer.stance.legs import one_foot_sink
from surefoot.stabilizer.walking.gait import HeightReference
from surefoot.stabilizer.walking.walk import Walk
from surefoot.stabilizer.whole_body.sway import Sway

KNEES_S = 0.5
"""Time constant of the lowest reference of the CoM when a walk begins or ends [s]."""


class WholeBodyController(BalanceController):
    """Implements sections III and IV of the paper, with joint position limits."""

    name = "whole-body"

    def __init__(
        self,
        robot: Robot,
        settings: ControllerSettings,
        *,
        extra_tasks: Sequence[Task] = (),
        estimator: StateEstimator | None = None,
        solver: Callable[[], QpSolver] = PiqpSolver,
    ) -> None:
        """Build the model and allocate all arrays.

        Args:
            robot: content of the robot's files.
            settings: gains, weights, limits.
            extra_tasks: tasks in addition to centre of mass, base and posture.
            estimator: used in place of the project's own.
            solver: makes the solver of each QP, for ticks in which limits are active.
        """
        super().__init__(robot, settings)
        self.dynamics = Dynamics(self.model)
        weight = self.model.mass * GRAVITY
        largest_force = settings.tsid.normal_force_max_weights * weight
        self.observer = Observer(
            self.model,
            settings,
            self.dynamics,
            largest_force=largest_force,
            period_s=robot.period_s,
            estimator=estimator,
        )
        self.tasks = [*standing_tasks(self.model, settings), *extra_tasks]
        lag_s = robot.servo_profile.lag_s
        self.com_wanted = self.stance.com.copy()
        self.walk = Walk(
            settings.walk,
            self.stance,
            robot=robot,
            model=self.model,
            contacts=self.observer.contacts,
            anchors=self.observer.anchors,
            largest_force=largest_force,
            height=HeightReference(
                settings.walk,
                com_rise=self.model.com_travel[1],
                period_s=robot.period_s,
            ),
            servo_lag_s=(1.0 - settings.dik.least_inverse) * lag_s
            + _damping_lag(robot, self.model),
        )
        self.tsid = Tsid(
            self.model,
            settings.tsid,
            self.tasks,
            swing=self.walk.swing_tasks,
            solver=solver,
        )
        self.law = ForceFeedback(
            settings.dik,
            settings.ground,
            settings.contact,
            half_sizes=self.model.half_sizes,
            sole_scale=settings.tsid.sole_scale,
            period_s=robot.period_s,
            lag_s=lag_s,
            speed=self._fastest_mode(robot),
            weight=self.model.weight,
            landing_force_n=settings.walk.landing_force_n,
        )
        self.dik = Dik(
            self.model,
            settings.dik,
            self.tasks,
            solver=solver,
        )
        self._reach = robot.command_reach[self.model.to_model]
        self.drives = DriveInverse(
            robot.servo_profile, most=self._reach, period_s=robot.period_s
        )
        self._q_command: Array = np.zeros(self.model.n_a)
        self._v_joint: Array = np.zeros(self.model.n_a)
        self._ages = ReadingAges(period_s=robot.period_s)
        self._deepest = self.model.com_travel[0]
        self._one_foot_depth = -one_foot_sink(self.model)
        self._approach = Approach(period_s=robot.period_s)
        self._sway = Sway(
            settings.sway,
            settings.walk,
            half_sizes=self.model.half_sizes,
            period_s=robot.period_s,
        )
        self._return_ticks = 0
        self._return_step: Array = np.zeros(self.model.n_a)

    def _fastest_mode(self, robot: Robot) -> float:
        """Return the speed of the fastest mode with default K, nominal stance [1/s]."""
        dynamics = self.dynamics
        dynamics.update(self.model.nominal_configuration(), np.zeros(self.model.n_v))
        return fastest_mode(
            dynamics,
            kp=robot.kp[self.model.to_model],
            contact_stiffness=self._settings.contact.stiffness_n_m,
        )

    def retune(self, settings: ControllerSettings) -> None:
        """Use new gains from the next step on; see :class:`Tunable`."""
        for task in self.tasks:
            task.retune(settings)
        self.law.retune(settings.dik, settings.ground)

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick, allowing for the readings' age; see the base class."""
        if snapshot.measured_ns and self._ages.add(snapshot):
            self.law.expect_age(
                forces_s=self._ages.forces_s, motion_s=self._ages.motion_s
            )
            self.walk.expect_age(self._ages.forces_s)
        return super().step(snapshot, reference)

    def follow_plan(self, plan: WalkPlan) -> None:
        """Follow a plan from the next call of ``step`` on; see :class:`Walks`."""
        self.walk.follow(plan)

    def degrade(self, lost: tuple[bool, bool]) -> None:
        """Go on without ankle sensors; see :meth:`Observer.leave_out`."""
        self.observer.leave_out(lost, instead=self.tsid.F_id)
        self.walk.end_early(blind=lost)

    def undo_overload(
        self, q_command: Array, *, ticks: int, sides: tuple[bool, bool]
    ) -> None:
        """Return to a former command at constant speed, added to the normal motion.

        The effect of false forces is undone as fast as it came about. Meanwhile the
        feet concerned show that return instead of their ground's motion.

        Args:
            q_command: (n_a,) the command before the false forces, bus order [rad].
            ticks: number of ticks for which the forces were false.
            sides: whether the forces of the left and of the right foot were false.
        """
        self._return_ticks = ticks
        self._return_step = (q_command[self.model.to_model] - self._q_command) / ticks
        for side in range(2):
            if sides[side]:
                self.law.suspend_feed_forward(side)

    def _take_over(self, q_command: Array) -> None:
        self._q_command[:] = q_command
        self.drives.take_over(q_command)

    def _command(self, state: ObservedState) -> tuple[QpStatus, QpStatus]:
        """Move the reference to its place for this tick, and solve."""
        dynamics, stance, walk = self.dynamics, self.stance, self.walk
        walk.update(state, dynamics, stance, law=self.law, tick=self._tick)
        stance.ground_acceleration[:2] = state.ground_acceleration
        deepest, highest = self.model.com_travel
        if walk.is_walking:  # a bent knee may not carry the robot alone
            deepest = max(deepest, self._one_foot_depth)
        self._deepest += self._dt / KNEES_S * (deepest - self._deepest)
        stance.limit_height(state.ground_height, travel=(self._deepest, highest))
        stance.compare_base(state.R_world_base)
        shifts = self._shifts(state)
        for shift in shifts:
            shift.move(stance, 1.0)
        self.com_wanted[:] = stance.com
        try:
            return self._solve(state)
        finally:
            for shift in shifts:
                shift.move(stance, -1.0)

    def _look_on(self, state: ObservedState) -> None:
        if self.walk.is_walking:
            self.walk.update(
                state, self.dynamics, self.stance, law=self.law, tick=self._tick
            )
        if self.drives.lags:
            self.drives.wait()

    def _shifts(self, state: ObservedState) -> list[Approach | Sway]:
        """Advance the offsets that move the reference, and return the active ones."""
        dynamics, stance, walk = self.dynamics, self.stance, self.walk
        approach, sway = self._approach, self._sway
        if state.is_calibrating:
            approach.begin(dynamics, stance)
            if sway.is_on:
                sway.begin(dynamics, stance)
            return []
        shifts: list[Approach | Sway] = []
        if not approach.is_over:
            approach.step()
            shifts.append(approach)
        if sway.is_on:
            is_to_walk = walk.is_walking or len(walk.queue) > 0
            stands = all(state.in_contact) and not is_to_walk
            sway.step(dynamics, stance, stands=stands)
            shifts.append(sway)
        return shifts

    def _solve(self, state: ObservedState) -> tuple[QpStatus, QpStatus]:
        """Solve both QPs and integrate."""
        dynamics, stance, walk = self.dynamics, self.stance, self.walk
        tsid = self.tsid.solve(
            dynamics,
            stance,
            in_contact=state.in_contact,
            allowed=state.allowed,
            airborne=walk.feet.airborne,
        )
        if not tsid.ok and tsid.status is not QpStatus.NO_CONTACT:
            self._keep_failure(tsid)
            return tsid.status, QpStatus.NOT_TRIED
        self.observer.assume_wanted()
        law = self.law
        law.landing, law.walks = walk.feet.landing, walk.is_walking
        law.turns = walk.ground_turns
        r = law.update(
            dynamics,
            stance,
            F_meas=state.F_meas,
            F_id=self.tsid.F_id,
            in_contact=state.in_contact,
            airborne=walk.feet.airborne,
        )
        walk.swing_twist(dynamics, law)
        dik = self.dik.solve(dynamics, stance, r=r, q_command=self._q_command)
        if not dik.ok:
            self._keep_failure(dik)
            return QpStatus.OK, dik.status
        self._v_joint[:] = dik.x[N_BASE_V:]
        # Drives that lag smooth a jump themselves, and their inverse counts on it.
        most = math.inf if self.drives.lags else CATCH_UP
        self._integrate(self._v_joint, self._ticks_of_motion(state, most=most))
        return QpStatus.OK, QpStatus.OK

    def _integrate(self, v_joint: Array, ticks: float) -> None:
        """Add v_J dt of this number of ticks to the command, kept near the robot."""
        motion = (ticks * self._dt) * v_joint
        if ticks > 1.0:
            np.minimum(motion, self._reach, out=motion)
            np.maximum(motion, -self._reach, out=motion)
        self._q_command += motion
        if self._return_ticks:
            self._return_ticks -= 1
            self._q_command += self._return_step
        q_joint = self.dynamics.q[7:]
        reach = self._settings.dik.windup_limit_rad
        q_command = self._q_command
        np.minimum(q_command, q_joint + reach, out=q_command)
        np.maximum(q_command, q_joint - reach, out=q_command)
        np.minimum(q_command, self.model.upper, out=q_command)
        np.maximum(q_command, self.model.lower, out=q_command)
        if self.drives.lags:
            self.drives.follow(q_command, share=self.law.inverse)

    def _output(self) -> ControllerOutput:
        q_command = self.drives.sent if self.drives.lags else self._q_command
        return ControllerOutput(
            q_command=q_command[self.model.to_bus],
            F_id=self.tsid.F_id,
            com=self.dynamics.p_com,
            r=self.law.r,
            v_joint=self._v_joint[self.model.to_bus],
            walk=self.walk.state,
        )


def _damping_lag(robot: Robot, model: RobotModel) -> float:
    """Return the lag of a leg's servos behind a moving command, kd / kp [s]."""
    lags = (robot.kd / robot.kp)[model.to_model]
    return float(np.median(lags[model.is_leg]))
