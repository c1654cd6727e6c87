"""The plant: one robot in its world, advanced tick by tick; no bus and no clock."""

from __future__ import annotations

import math

import mujoco

from robot_io.robot import Robot
from robot_io.snapshot import Snapshot
from schemas.arrays import Array
from schemas.scenario import Scenario
from sim_robot.constants import SIM_STEP_S
from sim_robot.errors import CommandError, ScenarioError
from sim_robot.ground import Ground
from sim_robot.pushes import Pushes
from sim_robot.quaternion import xyzw
from sim_robot.sensors import SensorSuite
from sim_robot.servos import Servos
from sim_robot.truth import PlantTruth, PlatformPose
from sim_robot.world import SENSOR_SOLES, World, build_world

SETTLE_S = 1.0
"""The nominal posture is held on still ground for so long before tick 0."""
FALL_HEIGHT_RATIO = 0.6
"""Base height above the soles, against standing, under which the robot fell."""
FALL_TILT_RAD = math.radians(60.0)
FALL_CLEARANCE_M = 0.03
"""Parts above the ankles that come so close to the lower sole's height fell."""
WHOLE_TICKS_TOLERANCE = 1e-6


class Plant:
    """A simulated robot on a scenario's ground.

    ``sense`` reads the present tick, ``step`` advances to the next; the same robot,
    scenario, seed and commands give the same readings, bit for bit. Joint state and
    poses are those of the tick, forces those of the simulation step before it.

    Attributes:
        world: the compiled model and its addresses.
        data: MuJoCo's state; to be read, not written.
    """

    def __init__(self, robot: Robot, scenario: Scenario, *, seed: int) -> None:
        """Builds the world and lets the robot settle in its nominal posture.

        Args:
            robot: from :func:`robot_io.robot.load_robot`.
            scenario: ground, pushes, sensors, sensor delay and model error; its
                command delay is not applied here.
            seed: of the sensor noise.

        Raises:
            ScenarioError: the scenario does not fit the robot or the simulation.
        """
        self.world: World = build_world(robot, scenario)
        self.data = mujoco.MjData(self.world.model)
        self._model = self.world.model
        self._substeps = whole_ticks(
            robot.period_s, SIM_STEP_S, what="the control period"
        )
        self._nominal = robot.nominal
        self._servos = Servos(
            robot.servo_profile, posture=robot.nominal, step_s=SIM_STEP_S
        )
        self._ground = Ground(self.world, self.data)
        self._pushes = Pushes(scenario.push, self.world)
        self._sensors = SensorSuite(
            self.world,
            scenario.sensors,
            period_s=robot.period_s,
            delay_ticks=whole_ticks(
                1e-3 * scenario.delay.sensor_ms, robot.period_s, what="delay.sensor_ms"
            ),
            seed=seed,
        )
        self._truth_platforms = tuple(
            body
            for body, plan in zip(
                self.world.ground_bodies, self.world.platforms, strict=True
            )
            if plan.in_scenario
        )
        self._tick = 0
        self._steps_done = 0
        self._settle()
        self._snapshot: Snapshot | None = None
        self._standing_height = self._height()

    @property
    def tick(self) -> int:
        """The present control tick."""
        return self._tick

    @property
    def fell(self) -> bool:
        """Whether the robot lies, or leans too far to come back, at this tick."""
        upright = self.data.xmat[self.world.base_body, 8] > math.cos(FALL_TILT_RAD)
        low = self._height() < FALL_HEIGHT_RATIO * self._standing_height
        left, right = self.world.sole_bodies
        xpos = self.data.xpos
        ground = min(xpos[left, 2], xpos[right, 2]) + FALL_CLEARANCE_M
        lying = xpos[self.world.upper_bodies, 2].min() < ground
        # A state that is not a number compares false: that is a fall, too.
        return bool(not upright or low or lying)

    def sense(self) -> Snapshot:
        """Reads the sensors at the present tick; the same reading if asked again."""
        if self._snapshot is None:
            self._snapshot = self._sensors.read(self.data, self._tick)
        return self._snapshot

    def step(self, q_command: Array) -> None:
        """Advances one control period.

        Args:
            q_command: (n_a,) position the servos are to follow [rad].

        Raises:
            CommandError: wrong size.
        """
        if q_command.shape != self._nominal.shape:
            raise CommandError(
                f"q_command: got shape {q_command.shape}, expected "
                f"{self._nominal.shape}, one position per joint of the robot file"
            )
        self.sense()
        for _ in range(self._substeps):
            self._pushes.apply(self.data, self._steps_done)
            self._steps_done += 1
            self._simulate(q_command, end_s=self._steps_done * SIM_STEP_S)
        self._tick += 1
        self._snapshot = None

    def truth(self) -> PlantTruth:
        """True state at the present tick."""
        data, world = self.data, self.world
        mujoco.mj_subtreeVel(self._model, data)
        left, right = world.sole_bodies
        wrenches = -data.sensordata[SENSOR_SOLES]
        return PlantTruth(
            tick=self._tick,
            base_position=data.qpos[:3].copy(),
            base_quat_xyzw=xyzw(data.qpos[3:7]),
            com=data.subtree_com[world.base_body].copy(),
            com_velocity=data.subtree_linvel[world.base_body].copy(),
            sole_left=data.xpos[left].copy(),
            sole_right=data.xpos[right].copy(),
            F_left=wrenches[:6],
            F_right=wrenches[6:],
            platforms=tuple(
                PlatformPose(
                    position=data.xpos[body].copy(),
                    quat_xyzw=xyzw(data.xquat[body]),
                )
                for body in self._truth_platforms
            ),
        )

    def _simulate(self, q_command: Array, *, end_s: float) -> None:
        """One simulation step up to ``end_s``.

        Forces and integration first, kinematics of the new state last: poses and
        velocities are then of the present, at no further cost.
        """
        self.data.ctrl[:] = self._servos.step(q_command)
        self._ground.aim(end_s)
        mujoco.mj_step2(self._model, self.data)
        self._ground.arrive()
        mujoco.mj_step1(self._model, self.data)

    def _settle(self) -> None:
        """Stands the robot on the ground and waits until it is at rest."""
        data, world = self.data, self.world
        data.qpos[:3] = 0.0, 0.0, world.base_height
        data.qpos[world.joint_qpos] = self._nominal
        mujoco.mj_step1(self._model, data)
        for _ in range(round(SETTLE_S / SIM_STEP_S)):
            self._simulate(self._nominal, end_s=0.0)
        data.time = 0.0

    def _height(self) -> float:
        """Base origin above the midpoint of the soles [m]."""
        left, right = self.world.sole_bodies
        z = self.data.xpos[:, 2]
        return float(z[self.world.base_body] - 0.5 * (z[left] + z[right]))


def whole_ticks(span_s: float, tick_s: float, *, what: str) -> int:
    """How many ticks a time span is.

    Args:
        span_s: the span [s].
        tick_s: one tick [s].
        what: named in the error.

    Raises:
        ScenarioError: the span is not a whole multiple of the tick.
    """
    ticks = round(span_s / tick_s)
    if abs(span_s - ticks * tick_s) > WHOLE_TICKS_TOLERANCE * tick_s:
        raise ScenarioError(
            f"{what}: got {1e3 * span_s:g} ms, expected a whole multiple of "
            f"{1e3 * tick_s:g} ms",
            field=what,
        )
    return ticks
