"""The simulated body: MuJoCo with the robot's servos, one control period per command.

Commands enter here after the gate and their delay; sensor readings leave for the bus.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from functools import partial

import mujoco
import numpy as np
from msgspec.structs import replace

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Vec3
from surefoot.schemas.messages import PushRequest
from surefoot.schemas.robot_file import ServoProfile
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.catalogue import SimulationError
from surefoot.sim_robot.conventions import SIM_STEP_S, whole_ticks
from surefoot.sim_robot.ground import Ground
from surefoot.sim_robot.metrics import Fall, FallDetector
from surefoot.sim_robot.pushes import CaptureLimit, Pushes, RodAtWork
from surefoot.sim_robot.robot_spec import LEVEL_RAD, Stance, per_joint
from surefoot.sim_robot.sensors import SensorSuite
from surefoot.sim_robot.state_view import PlantTruth, PlantView
from surefoot.sim_robot.world import Grasps, World, build_world, renew


class CommandError(SimulationError, ValueError):
    """A command has the wrong size, or answers a tick that is not open."""


class Servos:
    """Set-points that the servos follow, given the commanded positions.

    The set-point chases the command at the profile's speed limit. A first-order lag
    follows, discretised exactly for a set-point held over the step. The PD law itself
    runs in the simulation, on this set-point, every step.

    Attributes:
        setpoint: (n_a,) position the PD law acts on [rad]; a live array.
    """

    def __init__(self, profile: ServoProfile, *, posture: Array, step_s: float) -> None:
        """Start at rest in a posture.

        Args:
            profile: velocity limit and lag.
            posture: (n_a,) joint positions [rad].
            step_s: simulation step [s].
        """
        self._largest_change = profile.velocity_limit_rad_s * step_s
        self._lagging = profile.lag_s > 0.0
        self._gain = -math.expm1(-step_s / profile.lag_s) if self._lagging else 1.0
        self._limited = np.array(posture, dtype=np.float64)
        self._change = np.empty_like(self._limited)
        self.setpoint: Array = self._limited.copy() if self._lagging else self._limited

    def reset(self, posture: Array) -> None:
        """Reset to rest in ``posture``, (n_a,) [rad]."""
        np.copyto(self._limited, posture)
        np.copyto(self.setpoint, posture)

    def step(self, q_command: Array) -> Array:
        """Advance one simulation step towards a command.

        Args:
            q_command: (n_a,) commanded positions [rad].

        Returns:
            (n_a,) the live set-point for this step [rad].
        """
        change, limit = self._change, self._largest_change
        np.subtract(q_command, self._limited, out=change)
        np.minimum(change, limit, out=change)
        np.maximum(change, -limit, out=change)
        self._limited += change
        if self._lagging:
            np.subtract(self._limited, self.setpoint, out=change)
            change *= self._gain
            self.setpoint += change
        return self.setpoint


_LOG = logging.getLogger("surefoot.sim")
SUNK_M = 0.5
"""Soles that went down so far on still ground: more than soft ground gives."""


class Plant:
    """A simulated robot on a scenario's ground.

    ``sense`` reads the present tick, ``step`` advances to the next. The same robot,
    scenario, seed and commands give the same readings, bit for bit. Joint state and
    poses are those of the tick, forces those of the simulation step before it.

    Attributes:
        world: the compiled model and its addresses.
        data: MuJoCo's state; to be read, not written.
        posture: (n_a,) posture that the servos hold at tick 0 [rad].
        com_reference: (3,) CoM of the nominal stance, the reference of CoM errors [m].
        view: the true state at the present tick, not copied.
    """

    def __init__(self, robot: Robot, scenario: Scenario, *, seed: int) -> None:
        """Build the world and let the robot settle in its nominal posture.

        Args:
            robot: from :func:`surefoot.robot_io.robot.load_robot`.
            scenario: ground, pushes, sensors, sensor delay and model error; its
                command delay is not applied here.
            seed: seed of the sensor noise.

        Raises:
            ScenarioError: the scenario does not fit the robot or the simulation.
            RobotFileError: the robot does not stand in its nominal posture.
        """
        # Without this MuJoCo would write MUJOCO_LOG.TXT into the present folder.
        mujoco.set_mju_user_warning(_LOG.warning)
        self.world: World = build_world(robot, scenario)
        self.data = mujoco.MjData(self.world.model)
        self._model = self.world.model
        self.view = PlantView(self.world, self.data)
        self._ctrl = self.data.ctrl
        self._substeps = whole_ticks(
            robot.period_s, SIM_STEP_S, what="the control period"
        )
        self._nominal, self._name = robot.nominal, robot.file.name
        self.posture = self.world.start.posture
        error = scenario.model_error
        profile = robot.servo_profile
        if error.servo_lag_scale != 1.0:
            profile = replace(profile, lag_s=profile.lag_s * error.servo_lag_scale)
        self._servos = Servos(profile, posture=self.posture, step_s=SIM_STEP_S)
        play = per_joint(error.backlash_rad, robot, what="model_error.backlash_rad")
        self._half_play = 0.5 * play if play.any() else None
        self._grasps = Grasps(
            scenario.payload,
            self._model,
            renew=partial(renew, world=self.world, robot=robot),
        )
        self._ground = Ground(
            self.world.platforms, self.data, after=len(self.world.seesaws)
        )
        self._sensors = SensorSuite(
            self.world,
            self.data,
            settings=scenario.sensors,
            delay=scenario.delay,
            encoder_offset=per_joint(
                scenario.sensors.encoder_offset_rad,
                robot,
                what="sensors.encoder_offset_rad",
            ),
            period_s=robot.period_s,
            seed=seed,
            virtual=robot.file.virtual_ft,
        )
        self._tick = self._waited = 0
        self._steps_done = 0
        self._settle_s = scenario.start.settle_s
        self.com_reference = self._settle()
        self._pushes = Pushes(
            scenario.push,
            self.world,
            rods=scenario.rod,
            capture=CaptureLimit(robot, self.world, self.data),
        )
        self._snapshot: Snapshot | None = None
        self._fallen = FallDetector(self.view)

    @property
    def tick(self) -> int:
        """The present control tick."""
        return self._tick

    @property
    def fell(self) -> bool:
        """Whether the robot lies, or leans too far to come back, at this tick."""
        return self._fallen.check()

    @property
    def rods(self) -> list[RodAtWork]:
        """Rods of the scenario, in its order; for reading."""
        return self._pushes.rods.at_work

    def diagnose_fall(self) -> Fall:
        """Return how the robot fell; call it only after a fall."""
        return self._fallen.diagnose()

    def sense(self) -> Snapshot:
        """Read the sensors at the present tick; the same reading if asked again."""
        if self._snapshot is None:
            self._snapshot = self._sensors.read(self._waited + self._tick)
            if self._waited:
                self._snapshot = dataclasses.replace(self._snapshot, tick=self._tick)
        return self._snapshot

    def step(self, q_command: Array) -> None:
        """Advance one control period.

        Args:
            q_command: (n_a,) positions that the servos are to follow [rad].

        Raises:
            CommandError: the command has the wrong size.
        """
        if q_command.shape != self._nominal.shape:
            raise CommandError(
                f"q_command: got shape {q_command.shape}, expected "
                f"{self._nominal.shape}, one position per joint of the robot file"
            )
        self.sense()
        for _ in range(self._substeps):
            self._pushes.apply(self.data, self._steps_done)
            self._grasps.apply(self._steps_done)
            self._steps_done += 1
            self._simulate(q_command, end_s=self._steps_done * SIM_STEP_S)
        self._tick += 1
        self._snapshot = None

    def wait(self, q_command: Array) -> None:
        """Advance one control period before the scenario begins.

        The ground stands still and the tick stays the same; sensors and the stamps of
        their readings go on.

        Args:
            q_command: (n_a,) positions that the servos are to follow [rad].
        """
        self.sense()
        for _ in range(self._substeps):
            self._simulate(q_command, end_s=0.0)
        self._waited += 1
        self._snapshot = None

    def push(self, push: PushRequest) -> int:
        """Push the robot from the next tick on.

        Returns:
            The first tick in which the push acts.

        Raises:
            ScenarioError: the push cannot be done.
        """
        first_tick = self._tick + 1
        self._pushes.add(push, first_step=first_tick * self._substeps)
        return first_tick

    def truth(self) -> PlantTruth:
        """Return the true state at the present tick."""
        mujoco.mj_subtreeVel(self._model, self.data)
        return self.view.truth(self._tick)

    def _simulate(self, q_command: Array, *, end_s: float) -> None:
        """Simulate one step up to ``end_s``.

        Forces and integration come first, kinematics of the new state last. So poses
        and velocities are those of the present, at no further cost.
        """
        self._ctrl[:] = self._servos.step(q_command)
        if self._half_play is not None:
            # The servo feels only the error beyond the play.
            error = self._ctrl - self.data.qpos.take(self.world.joint_qpos)
            self._ctrl -= np.clip(error, -self._half_play, self._half_play)
        self._ground.aim(end_s)
        self._sensors.begin_step()
        mujoco.mj_step2(self._model, self.data)
        self._ground.arrive()
        mujoco.mj_step1(self._model, self.data)

    def _settle(self) -> Vec3:
        """Stand the robot on the ground and let it come to rest.

        Returns:
            (3,) centre of mass of the nominal posture on level ground [m], x and y from
            the midpoint of the soles, before the servos yield to the weight.

        Raises:
            RobotFileError: the robot does not stand there.
        """
        data, world = self.data, self.world
        self._place(world.nominal)
        reference = self.view.com.copy()
        reference[:2] -= 0.5 * (self.view.sole_left + self.view.sole_right)[:2]
        tilt = max(self.view.sole_tilts)
        if tilt > LEVEL_RAD:
            raise self._lies(f"soles {math.degrees(tilt):.1f} deg off level")
        if world.start is not world.nominal:
            self._place(world.start)
        fallen = FallDetector(self.view)
        before = self._sole_height()
        for _ in range(round(self._settle_s / SIM_STEP_S)):
            self._simulate(self.posture, end_s=0.0)
        data.time = 0.0
        if fallen.check():
            raise self._lies(fallen.diagnose().detail)
        sunk = before - self._sole_height()
        if sunk > SUNK_M:  # upright all the same: nothing else shows it
            raise self._lies(f"the soles sank by {sunk:.1f} m, nothing carries them")
        return reference

    def _sole_height(self) -> float:
        _, left, right, *_ = self.view.heights()
        return 0.5 * (left + right)

    def _place(self, stance: Stance) -> None:
        data, world = self.data, self.world
        data.qpos[:2] = stance.place
        data.qpos[2] = stance.base_height + world.rise
        data.qpos[3:7] = stance.base_quat_wxyz
        data.qpos[world.joint_qpos] = stance.posture
        mujoco.mj_step1(self._model, data)

    def _lies(self, why: str) -> RobotFileError:
        which = "nominal" if self.world.start is self.world.nominal else "starting"
        return RobotFileError(
            f"{self._name}: does not stand in its {which} posture: {why}; expected it "
            f"to stand still for {self._settle_s:g} s before the run: correct the "
            "joints' `nominal` in the robot file, or the scenario's [start], "
            "[model_error], [[payload]] and the [[tile]] or [[platform]] under its feet"
        )
