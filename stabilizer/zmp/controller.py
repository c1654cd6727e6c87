"""The ZMP baseline: sensors in, joint command out, nothing else.

Data flows one way: snapshot -> estimator -> DCM feedback -> distribution -> foot
admittance -> inverse kinematics of the commanded robot. No clock, no I/O, no
randomness.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.controller import ControllerOutput
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.estimation.contact import ContactMonitor
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.estimation.wrench_compensation import WrenchCompensation
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, RobotModel
from surefoot.stabilizer.qp import QpData
from surefoot.stabilizer.safety.health import is_finite
from surefoot.stabilizer.zmp.commanded_robot import CommandedRobot, ComTarget
from surefoot.stabilizer.zmp.dcm_feedback import (
    GRAVITY_VECTOR,
    DcmFeedback,
    StandingPendulum,
)
from surefoot.stabilizer.zmp.distribution import (
    NORMAL,
    WrenchDistribution,
    contact_plane,
    net_wrench,
    zero_moment_point,
)
from surefoot.stabilizer.zmp.foot_admittance import ComAdmittance, FootAdmittance
from surefoot.stabilizer.zmp.kinematics import Kinematics

GROUND_SPEED_LAG_S = 0.02
"""Low-pass of the ground's vertical speed, for a level height [s]."""


class ZmpController:
    """Implements the stabilizer of Caron et al., ICRA 2019; see docs/zmp-baseline.md.

    Attributes:
        name: as named on the command line.
        failure: the first QP that could not be solved, kept for replay.
    """

    name = "zmp"

    def __init__(self, robot: Robot, settings: ControllerSettings) -> None:
        """Build the model and allocate everything."""
        self._settings = settings
        zmp, self._dt = settings.zmp, robot.period_s
        self.model = RobotModel(robot)
        self.stance = standing(self.model)
        self.estimator = Estimator(
            self.model, settings.estimator, period_s=robot.period_s
        )
        self.measured = Kinematics(self.model)
        self.wrenches = WrenchCompensation(self.model)
        self._weight = self.model.mass * GRAVITY
        self.contacts = ContactMonitor(
            settings.contact, largest_force=self._weight, period_s=robot.period_s
        )
        self.pendulum = StandingPendulum(self.stance.com, period_s=robot.period_s)
        self.feedback = DcmFeedback(zmp, period_s=robot.period_s)
        self.distribution = WrenchDistribution(self.model, zmp)
        self.feet = FootAdmittance(zmp)
        self.com_admittance = ComAdmittance(zmp, period_s=robot.period_s)
        self.commanded = CommandedRobot(
            self.model, zmp, settings.dik, period_s=robot.period_s
        )
        self.failure: QpData | None = None
        self._velocity: Vec3 = np.zeros(3)
        self._twist: Array = np.zeros(12)
        self._velocity_blend = min(1.0, self._dt / zmp.com_velocity_lag_s)
        self._height = self.stance.com_height
        self._lift = 0.0
        self._lift_rate = 0.0
        self._normals = [0.5 * self._weight] * 2
        self._since_start_s = 0.0
        self._reference: Reference | None = None

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still.

        Args:
            snapshot: first reading of all sensors.
            q_command: (n_a,) posture the servos hold, bus order [rad].
        """
        self.estimator.calibrate(snapshot)
        self.commanded.start(q_command[self.model.to_model])
        self._since_start_s = 0.0

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick.

        Args:
            snapshot: reading of all sensors.
            reference: newest word of a planner, if any; its CoM, posture and base.

        Returns:
            Joint command in bus order, and what led to it.
        """
        if not is_finite(snapshot):
            return self._answer(wrench_qp="sensors not finite")
        if reference is not None and reference is not self._reference:
            self.stance.set(reference, self.model)
            self._reference = reference
        calibrating = self._estimate(snapshot)
        self.measured.update(self.estimator.q, self.estimator.v)
        F_meas = self.wrenches.update(
            snapshot.ft_left, snapshot.ft_right, self.measured.R_world_sole
        )
        self._normals = [float(F_meas[NORMAL]), float(F_meas[6 + NORMAL])]
        self.contacts.update(*self._normals)
        self._velocity += self._velocity_blend * (self.measured.v_com - self._velocity)
        self._follow_height()
        if calibrating:
            return self._answer()
        wrench_qp, motion_qp = self._command(F_meas)
        return self._answer(wrench_qp=wrench_qp, motion_qp=motion_qp)

    def _estimate(self, snapshot: Snapshot) -> bool:
        """Update the observer; whether it is still being calibrated."""
        self._since_start_s += self._dt
        if self._since_start_s < self._settings.estimator.calibration_s:
            self.estimator.calibrate(snapshot)
            return True
        left, right = self._normals
        self.estimator.update(snapshot, normal_left=left, normal_right=right)
        return False

    def _follow_height(self) -> None:
        """How far the CoM should be from its height over the feet, and how fast."""
        ground = self.estimator.ground_height
        stance, travel = self.stance, self.model.com_travel
        # Over the feet first, then where it is in the world, each within reach.
        stance.limit_height(0.0, travel=travel)
        self._height = stance.com.item(2)
        stance.limit_height(ground, travel=travel)
        share = self._settings.zmp.level_height
        lift = share * (stance.com.item(2) - ground - self._height)
        rate = (lift - self._lift) / self._dt
        self._lift_rate += self._dt / GROUND_SPEED_LAG_S * (rate - self._lift_rate)
        self._lift = lift

    def _command(self, F_meas: Array) -> tuple[str, str]:
        """All laws and the integration; the posture is held when a QP fails."""
        in_contact, commanded = self.contacts.in_contact, self.commanded
        target = self.stance.com.copy()
        target[2] = self._height
        self.pendulum.update(target)
        status = self._distribute(F_meas)
        if status != "ok":
            return status, "not tried"
        self._twist = twist = self.feet.update(
            F_meas=F_meas,
            F_wanted=self.distribution.F,
            in_contact=in_contact,
            R_measured=self.measured.R_world_sole,
            R_commanded=commanded.kinematics.R_world_sole,
            p_commanded=commanded.kinematics.p_sole,
            p_stance=commanded.p_stance,
        )
        ik = commanded.solve(
            twist=twist,
            in_contact=in_contact,
            com=self._com_target(),
            R_base=self._base_target(),
            posture=self.stance.posture,
        )
        if not ik.ok:
            self._keep_failure(commanded.qp.data(ik.status))
            return "ok", ik.status
        active_s = self._since_start_s - self._settings.estimator.calibration_s
        fade = min(max(active_s / self._settings.dik.ramp_in_s, 0.0), 1.0)
        commanded.integrate(ik.x, self.estimator.q[N_BASE_V + 1 :], fade=fade)
        return "ok", "ok"

    def _distribute(self, F_meas: Array) -> str:
        """DCM feedback, distribution, and the CoM admittance between them."""
        measured, in_contact = self.measured, self.contacts.in_contact
        R, p, com = measured.R_world_sole, measured.p_sole, measured.p_com
        plane = contact_plane(R, p, in_contact)
        omega = self.pendulum.omega
        nowhere = com + GRAVITY_VECTOR / (omega * omega)
        felt = net_wrench(F_meas, R, p, plane.origin)
        zmp = zero_moment_point(felt, plane, otherwise=nowhere)
        acceleration = self.feedback.update(
            self.pendulum,
            com=com,
            velocity=self._velocity,
            zmp=zmp,
            in_air=not any(in_contact),
            yaw=self._heading(),
        )
        # A force through the measured centre of mass: no moment about it.
        wanted = np.zeros(6)
        wanted[:3] = self.model.mass * (acceleration - GRAVITY_VECTOR)
        solution = self.distribution.solve(
            wanted, R_world_sole=R, p_sole=p, point=com, in_contact=in_contact
        )
        if solution is not None and not solution.ok:
            problem = self.distribution.problem(in_contact)
            self._keep_failure(problem.data(solution.status))
            return solution.status
        shared = net_wrench(self.distribution.F, R, p, plane.origin)
        distributed = zero_moment_point(shared, plane, otherwise=nowhere)
        self.com_admittance.update(
            distributed=distributed, measured=zmp, active=all(in_contact)
        )
        return "ok"

    def _heading(self) -> float:
        """Twist of the base about the vertical [rad]."""
        _, _, z, w = self.estimator.q[N_BASE_V - 3 : N_BASE_V + 1]
        return 2.0 * math.atan2(z, w)

    def _com_target(self) -> ComTarget:
        """Pendulum, CoM admittance and height in one."""
        admittance, pendulum = self.com_admittance, self.pendulum
        position = pendulum.com + admittance.offset
        velocity = pendulum.velocity + admittance.velocity
        position[2] += self._lift
        velocity[2] += self._lift_rate
        return ComTarget(
            position, velocity, pendulum.acceleration + admittance.acceleration
        )

    def _base_target(self) -> Mat:
        """Between the commanded feet's orientation and the reference's."""
        left, right = self.commanded.kinematics.R_world_sole
        anchor = right @ pin.exp3(0.5 * pin.log3(right.T @ left))
        share = self._settings.zmp.level_base
        turned: Mat = anchor @ pin.exp3(share * pin.log3(anchor.T @ self.stance.R_base))
        return turned

    def _answer(
        self, *, wrench_qp: str = "ok", motion_qp: str = "ok"
    ) -> ControllerOutput:
        """The answer as it stands: the command, old or new, and what led to it."""
        return ControllerOutput(
            q_command=self.commanded.q[N_BASE_V + 1 :][self.model.to_bus],
            F_id=self.distribution.F,
            F_meas=self.wrenches.F_meas,
            com=self.measured.p_com,
            com_reference=self.stance.com,
            in_contact=(self.contacts.in_contact[0], self.contacts.in_contact[1]),
            base_pose=self.estimator.q[:7],
            base_twist=self.estimator.v[:6],
            r=self._twist,
            wrench_qp=wrench_qp,
            motion_qp=motion_qp,
        )

    def _keep_failure(self, data: QpData) -> None:
        if self.failure is None:
            self.failure = data
