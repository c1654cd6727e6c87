"""The ZMP baseline: sensors in, joint command out, nothing else.

Data flows one way: snapshot -> observer -> DCM feedback -> distribution -> foot
admittance -> inverse kinematics of the commanded robot. No clock, no I/O, no
randomness.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.walk_plan import WalkPlan
from surefoot.stabilizer.controller import BalanceController, ControllerOutput
from surefoot.stabilizer.estimation.observer import (
    ObservedState,
    Observer,
    StateEstimator,
)
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, yaw_from
from surefoot.stabilizer.qp import QpStatus
from surefoot.stabilizer.walking.gait import Phase
from surefoot.stabilizer.walking.walk import Walk
from surefoot.stabilizer.zmp.commanded_robot import (
    CommandedRobot,
    ComTarget,
    Kinematics,
)
from surefoot.stabilizer.zmp.dcm_feedback import (
    GRAVITY_VECTOR,
    DcmFeedback,
    StandingPendulum,
)
from surefoot.stabilizer.zmp.distribution import (
    WrenchDistribution,
    contact_plane,
    net_wrench,
    zero_moment_point,
)
from surefoot.stabilizer.zmp.foot_admittance import FootAdmittance, ZmpCompensation

GROUND_SPEED_LAG_S = 0.02
"""Low-pass of the ground's vertical speed, used for a level height [s]."""


class UnknownGround:
    """Ground that is assumed to be at rest, since only the feet on it are known."""

    def __init__(self) -> None:
        """Take no part of the soles' motion as the ground's."""
        self.share = [0.0, 0.0]
        self.ground_twist: Array = np.zeros(12)


class ZmpController(BalanceController):
    """The stabilizer of Caron et al., ICRA 2019; see docs/zmp-baseline.md."""

    name = "zmp"

    def __init__(
        self,
        robot: Robot,
        settings: ControllerSettings,
        *,
        estimator: StateEstimator | None = None,
    ) -> None:
        """Build the model and allocate everything."""
        super().__init__(robot, settings)
        zmp = settings.zmp
        self.measured = Kinematics(self.model)
        self.observer = Observer(
            self.model,
            settings,
            self.measured,
            largest_force=self.model.mass * GRAVITY,
            period_s=robot.period_s,
            estimator=estimator,
        )
        self.pendulum = StandingPendulum(self.stance.com, period_s=robot.period_s)
        self.feedback = DcmFeedback(zmp, period_s=robot.period_s)
        self.distribution = WrenchDistribution(self.model, zmp)
        self.feet = FootAdmittance(zmp)
        self.com_admittance = ZmpCompensation(zmp, period_s=robot.period_s)
        self.commanded = CommandedRobot(
            self.model, zmp, settings.dik, period_s=robot.period_s
        )
        self.walk = Walk(
            settings.walk,
            self.stance,
            robot=robot,
            model=self.model,
            contacts=self.observer.contacts,
            anchors=self.observer.anchors,
            largest_force=self.model.mass * GRAVITY,
            height=None,
            servo_lag_s=0.0,
        )
        self._ground = UnknownGround()
        self._velocity: Vec3 = np.zeros(3)
        self._twist: Array = np.zeros(12)
        self._wanted: Array | None = None
        self._velocity_blend = min(1.0, self._dt / zmp.com_velocity_cutoff_period_s)
        self._height = self.stance.com_height
        self._level = 0.0
        self._level_blend = min(1.0, self._dt / settings.walk.height_s)
        self._is_placed = False
        self._lift = 0.0
        self._lift_rate = 0.0

    def follow_plan(self, plan: WalkPlan) -> None:
        """Follow a plan from the next call of ``step`` on; see :class:`Walks`."""
        self.walk.follow(plan)

    def _take_over(self, q_command: Array) -> None:
        self.commanded.start(q_command)

    def _command(self, state: ObservedState) -> tuple[QpStatus, QpStatus]:
        """Apply all laws and integrate; nothing moves while calibrating."""
        self._look_on(state)
        if state.is_calibrating:
            return QpStatus.OK, QpStatus.OK
        in_contact, commanded = state.in_contact, self.commanded
        target = self.stance.com.copy()
        target[2] = self._height
        self.pendulum.update(target)
        if self.walk.is_walking:
            gait = self.walk.gait
            self.pendulum.follow(self.stance, zmp=gait.zmp, omega=gait.omega)
        status = self._distribute(state)
        if status is not QpStatus.OK:
            return status, QpStatus.NOT_TRIED
        self._twist = twist = self.feet.update(
            F_meas=state.F_meas,
            F_desired=self.distribution.F,
            in_contact=in_contact,
            R_measured=self.measured.R_world_sole,
            R_commanded=commanded.kinematics.R_world_sole,
            p_commanded=commanded.kinematics.p_sole,
            p_stance=commanded.p_stance,
        )
        self._swing(twist)
        ik = commanded.solve(
            twist=twist,
            in_contact=in_contact,
            com=self._com_target(),
            R_base=self._base_target(),
            posture=self.stance.posture,
        )
        if not ik.ok:
            self._keep_failure(ik)
            return QpStatus.OK, ik.status
        measured = state.q[N_BASE_V + 1 :]
        commanded.integrate(ik.x, measured, ticks=self._ticks_of_motion(state))
        return QpStatus.OK, QpStatus.OK

    def _look_on(self, state: ObservedState) -> None:
        self._velocity += self._velocity_blend * (self.measured.v_com - self._velocity)
        self._stand_on_support()
        self.walk.update(
            state,
            self.measured,
            self.stance,
            law=self._ground,
            tick=self._tick,
            commanded=self.commanded.kinematics,
        )
        self._follow_height(state.ground_height)

    def _stand_on_support(self) -> None:
        """Move the commanded robot to where the real one stands, once per step."""
        gait = self.walk.gait
        is_due = gait.phase in (Phase.SHIFT, Phase.DOUBLE) and gait.left_s == 0.0
        if is_due and not self._is_placed:
            side, measured = gait.support, self.measured
            p = measured.p_sole[side].copy()
            p[2] = self._levels()[side]
            yaw = yaw_from(measured.R_world_sole[side], 0.0)
            self.commanded.stand_at(side, p=p, yaw=yaw)
        self._is_placed = is_due

    def _levels(self) -> list[float]:
        """Return the planned heights of the footholds [m]."""
        anchors = self.observer.anchors
        return [0.0, 0.0] if anchors is None else anchors.level

    def _swing(self, twist: Array) -> None:
        """Lead a foot in the air along its path, and set it down where it lands."""
        airborne = self.walk.feet.airborne
        for side, reference in enumerate(self.walk.swing_references):
            if side == airborne:
                self.commanded.swing(side, reference, twist)
            else:
                self.commanded.set_down(side)

    def _follow_height(self, ground: float) -> None:
        """Update the CoM's height over the feet from the ground's height."""
        stance, travel = self.stance, self.model.com_travel
        if self.walk.state is not None:
            left, right = self._levels()
            self._level += self._level_blend * (0.5 * (left + right) - self._level)
            stance.com_height = stance.com_nominal + self._level
        # First the height over the feet, then the one in the world, each within reach.
        stance.limit_height(self._level, travel=travel)
        self._height = stance.com.item(2)
        stance.limit_height(ground, travel=travel)
        share = self._settings.zmp.level_height
        lift = share * (stance.com.item(2) - ground - self._height)
        rate = (lift - self._lift) / self._dt
        self._lift_rate += self._dt / GROUND_SPEED_LAG_S * (rate - self._lift_rate)
        self._lift = lift

    def _distribute(self, state: ObservedState) -> QpStatus:
        """Run DCM feedback and distribution, and the CoM admittance between them."""
        measured, in_contact = self.measured, state.in_contact
        R, p, com = measured.R_world_sole, measured.p_sole, measured.p_com
        plane = contact_plane(R, p, in_contact)
        omega = self.pendulum.omega
        nowhere = com + GRAVITY_VECTOR / (omega * omega)
        felt = net_wrench(state.F_meas, R, p, plane.origin)
        zmp = zero_moment_point(felt, plane, otherwise=nowhere)
        acceleration = self.feedback.update(
            self.pendulum,
            com=com,
            velocity=self._velocity,
            zmp=zmp,
            in_air=not any(in_contact),
            yaw=_heading(state.q),
        )
        # A force through the measured centre of mass: no moment about it.
        wanted = np.zeros(6)
        wanted[:3] = self.model.mass * (acceleration - GRAVITY_VECTOR)
        solution = self.distribution.solve(
            wanted,
            R_world_sole=R,
            p_sole=p,
            point=com,
            in_contact=in_contact,
            left_share=self.stance.load[0],
        )
        if solution is not None and not solution.ok:
            self._keep_failure(solution)
            return solution.status
        self._wanted = self.distribution.F
        shared = net_wrench(self.distribution.F, R, p, plane.origin)
        distributed = zero_moment_point(shared, plane, otherwise=nowhere)
        self.com_admittance.update(
            distributed=distributed, measured=zmp, active=all(in_contact)
        )
        return QpStatus.OK

    def _com_target(self) -> ComTarget:
        """Return the sum of pendulum, CoM admittance and height."""
        admittance, pendulum = self.com_admittance, self.pendulum
        position = pendulum.com + admittance.offset
        velocity = pendulum.velocity + admittance.velocity
        position[2] += self._lift
        velocity[2] += self._lift_rate
        return ComTarget(
            position, velocity, pendulum.acceleration + admittance.acceleration
        )

    def _base_target(self) -> Mat:
        """Return a rotation between the commanded feet's and the reference's."""
        left, right = self.commanded.kinematics.R_world_sole
        anchor = right @ pin.exp3(0.5 * pin.log3(right.T @ left))
        share = self._settings.zmp.level_base
        turned: Mat = anchor @ pin.exp3(share * pin.log3(anchor.T @ self.stance.R_base))
        return turned

    def _output(self) -> ControllerOutput:
        return ControllerOutput(
            q_command=self.commanded.q[N_BASE_V + 1 :][self.model.to_bus],
            F_id=self._wanted,
            com=self.measured.p_com,
            r=self._twist,
            walk=self.walk.state,
        )


def _heading(q: Array) -> float:
    """Return the heading of the base [rad]."""
    _, _, z, w = q[N_BASE_V - 3 : N_BASE_V + 1]
    return 2.0 * math.atan2(z, w)
