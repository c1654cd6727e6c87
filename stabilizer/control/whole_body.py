"""The whole-body stabilizer: sensors in, joint command out, nothing else.

Data flows one way: snapshot -> estimator -> dynamics -> wrenches -> contacts -> TSID
-> wrench law -> DIK -> integration. No clock, no I/O, no randomness.
"""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.controller import ControllerOutput
from surefoot.stabilizer.control.dik import Dik
from surefoot.stabilizer.control.force_feedback import NORMAL, ForceFeedback
from surefoot.stabilizer.control.reference import standing
from surefoot.stabilizer.control.tsid import NO_CONTACT, Tsid
from surefoot.stabilizer.dynamics import SOLE_ROWS, Dynamics
from surefoot.stabilizer.estimation.contact import ContactMonitor
from surefoot.stabilizer.estimation.estimator import Estimator
from surefoot.stabilizer.estimation.wrench_compensation import WrenchCompensation
from surefoot.stabilizer.model import GRAVITY, N_BASE_V, RobotModel
from surefoot.stabilizer.qp import QpData
from surefoot.stabilizer.safety.health import is_finite


class WholeBodyController:
    """Implements sections III and IV of the paper, with joint position limits.

    Attributes:
        name: as named on the command line.
        failure: the first QP that could not be solved, kept for replay.
    """

    name = "whole-body"

    def __init__(self, robot: Robot, settings: ControllerSettings) -> None:
        """Build the model and allocate everything."""
        self._settings = settings
        self._dt = robot.period_s
        self.model = RobotModel(robot)
        self.stance = standing(self.model)
        self.estimator = Estimator(
            self.model, settings.estimator, period_s=robot.period_s
        )
        self.dynamics = Dynamics(self.model)
        self.wrenches = WrenchCompensation(self.model)
        weight = self.model.mass * GRAVITY
        self.contacts = ContactMonitor(
            settings.contact,
            largest_force=settings.tsid.normal_force_max_weights * weight,
            period_s=robot.period_s,
        )
        self.tsid = Tsid(self.model, settings.tsid)
        self.law = ForceFeedback(
            settings.dik,
            settings.ground,
            settings.contact,
            half_sizes=self.model.half_sizes,
            period_s=robot.period_s,
            lag_s=robot.servo_profile.lag_s,
        )
        self.dik = Dik(self.model, settings.dik)
        self.failure: QpData | None = None
        self._q_command: Array = np.zeros(self.model.n_a)
        self._v_joint: Array = np.zeros(self.model.n_a)
        self._weight = weight
        self._normals = [0.5 * weight] * 2
        self._lost = (False, False)
        self._return_ticks = 0
        self._return_step: Array = np.zeros(self.model.n_a)
        self._since_start_s = 0.0
        self._reference: Reference | None = None

    def retune(self, settings: ControllerSettings) -> None:
        """Use new gains from the next step on; see :class:`Tunable`."""
        self._settings = settings
        self.tsid.retune(settings.tsid)
        self.dik.retune(settings.dik)
        self.law.retune(settings.dik, settings.ground)

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still.

        Args:
            snapshot: first reading of all sensors.
            q_command: (n_a,) posture the servos hold, bus order [rad].
        """
        self.estimator.calibrate(snapshot)
        self._q_command[:] = q_command[self.model.to_model]
        self._return_ticks = 0
        self._since_start_s = 0.0

    def degrade(self, lost: tuple[bool, bool]) -> None:
        """Go on without ankle sensors.

        A foot without its sensor is taken to feel what it should, so that its force
        terms vanish, and to carry what the other one does not.

        Args:
            lost: whether the left and the right sensor are to be left out.
        """
        self._lost = lost

    def undo_overload(
        self, q_command: Array, *, ticks: int, sides: tuple[bool, bool]
    ) -> None:
        """Return to a former command, at constant speed and on top of all else.

        What false forces have led to is undone as fast as it was done. Meanwhile the
        feet concerned do not show their ground's motion, but that return.

        Args:
            q_command: (n_a,) the command before, bus order [rad].
            ticks: how long the forces were false.
            sides: whether those of the left and of the right foot were.
        """
        self._return_ticks = ticks
        self._return_step = (q_command[self.model.to_model] - self._q_command) / ticks
        for side in range(2):
            if sides[side]:
                self.law.suspend_feed_forward(side)

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick.

        Args:
            snapshot: reading of all sensors.
            reference: newest word of a planner, if any.

        Returns:
            Joint command in bus order, and what led to it.
        """
        if not is_finite(snapshot):
            return self._answer(wrench_qp="sensors not finite")
        if reference is not None and reference is not self._reference:
            self.stance.set(reference, self.model)
            self._reference = reference
        self._estimate(snapshot)
        self.dynamics.update(self.estimator.q, self.estimator.v)
        F_meas = self.wrenches.update(
            snapshot.ft_left, snapshot.ft_right, self.dynamics.R_world_sole
        )
        if any(self._lost):
            self._assume(F_meas)
        self._normals = [float(F_meas[NORMAL]), float(F_meas[6 + NORMAL])]
        self.contacts.update(*self._normals)
        self.stance.limit_height(
            self.estimator.ground_height, travel=self.model.com_travel
        )
        self.stance.compare_base(self.estimator.R_world_base)
        wrench_qp, motion_qp = self._command(F_meas)
        return self._answer(wrench_qp=wrench_qp, motion_qp=motion_qp)

    def _answer(
        self, *, wrench_qp: str = "ok", motion_qp: str = "ok"
    ) -> ControllerOutput:
        """The answer as it stands: the command, old or new, and what led to it."""
        return ControllerOutput(
            q_command=self._q_command[self.model.to_bus],
            F_id=self.tsid.F_id,
            F_meas=self.wrenches.F_meas,
            com=self.dynamics.p_com,
            com_reference=self.stance.com,
            in_contact=(self.contacts.in_contact[0], self.contacts.in_contact[1]),
            base_pose=self.estimator.q[:7],
            base_twist=self.estimator.v[:6],
            r=self.law.r,
            v_joint=self._v_joint[self.model.to_bus],
            wrench_qp=wrench_qp,
            motion_qp=motion_qp,
        )

    def _estimate(self, snapshot: Snapshot) -> None:
        self._since_start_s += self._dt
        if self._since_start_s < self._settings.estimator.calibration_s:
            self.estimator.calibrate(snapshot)
            return
        left, right = self._normals
        self.estimator.update(snapshot, normal_left=left, normal_right=right)

    def _assume(self, F_meas: Array) -> None:
        """Put what may be assumed in the place of what is not measured."""
        normals = (F_meas.item(NORMAL), F_meas.item(6 + NORMAL))
        for side, rows in enumerate(SOLE_ROWS):
            if self._lost[side]:
                F_meas[rows] = self.tsid.F_id[rows]
                if not self._lost[1 - side]:
                    rest = self._weight - max(normals[1 - side], 0.0)
                    F_meas[rows.start + NORMAL] = max(rest, 0.0)

    def _command(self, F_meas: Array) -> tuple[str, str]:
        """Both QPs and the integration; the posture is held when one fails."""
        contacts, dynamics, stance = self.contacts, self.dynamics, self.stance
        tsid = self.tsid.solve(
            dynamics, stance, in_contact=contacts.in_contact, allowed=contacts.allowed
        )
        if not tsid.ok and tsid.status != NO_CONTACT:
            self._keep_failure(self.tsid.problem(contacts.in_contact).data(tsid.status))
            return tsid.status, "not tried"
        for side, rows in enumerate(SOLE_ROWS):
            if self._lost[side]:
                F_meas[rows] = self.tsid.F_id[rows]  # no error, no force term
        r = self.law.update(
            dynamics,
            stance,
            F_meas=F_meas,
            F_id=self.tsid.F_id,
            in_contact=contacts.in_contact,
        )
        dik = self.dik.solve(dynamics, stance, r=r, q_command=self._q_command)
        if not dik.ok:
            self._keep_failure(self.dik.qp.data(dik.status))
            return "ok", dik.status
        self._v_joint[:] = dik.x[N_BASE_V:]
        self._integrate(self._v_joint)
        return "ok", "ok"

    def _integrate(self, v_joint: Array) -> None:
        """q_command += v_J dt, faded in at the start, never far from the robot."""
        settings = self._settings.dik
        active_s = self._since_start_s - self._settings.estimator.calibration_s
        fade = min(max(active_s / settings.ramp_in_s, 0.0), 1.0)
        self._q_command += (fade * self._dt) * v_joint
        if self._return_ticks:
            self._return_ticks -= 1
            self._q_command += self._return_step
        q_joint = self.dynamics.q[7:]
        reach = settings.windup_limit_rad
        q_command = self._q_command
        np.minimum(q_command, q_joint + reach, out=q_command)
        np.maximum(q_command, q_joint - reach, out=q_command)
        np.minimum(q_command, self.model.upper, out=q_command)
        np.maximum(q_command, self.model.lower, out=q_command)

    def _keep_failure(self, data: QpData) -> None:
        if self.failure is None:
            self.failure = data
