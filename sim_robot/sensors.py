"""The robot's sensors: truth in, what the robot reports out."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import mujoco
import numpy as np

from robot_io.snapshot import Snapshot
from schemas.scenario import Sensors
from sim_robot.accelerometer import Accelerometer
from sim_robot.encoders import Encoders
from sim_robot.noise import ACCEL, FT_LEFT, FT_RIGHT, GYRO, SensorNoise
from sim_robot.quaternion import xyzw
from sim_robot.robot_spec import (
    SENSOR_FT,
    SENSOR_IMU_VELOCITY,
    SENSOR_NOISY,
    SENSOR_QUAT_WXYZ,
)
from sim_robot.world import World

NANOSECONDS = 1_000_000_000


class SensorSuite:
    """Reads all sensors of a tick: noise, bias, resolution and delay.

    Joint positions, velocities, attitude and gyroscope are of the tick; wrenches and
    efforts are those of the simulation step that led to it; the accelerometer tells
    the mean over the control period. The attitude is the true one, without noise.
    Biases act on every axis. Each sensor has its own random numbers.
    """

    def __init__(
        self,
        world: World,
        data: mujoco.MjData,
        *,
        settings: Sensors,
        period_s: float,
        delay_ticks: int,
        seed: int,
    ) -> None:
        """Sets up the sensors.

        Args:
            world: where the readings are.
            data: the state to read, from then on.
            settings: noise, biases and resolution of the scenario.
            period_s: control period.
            delay_ticks: a snapshot reports what was so many ticks ago.
            seed: of the run; equal seeds give equal noise.
        """
        self._joint_qpos, self._joint_dof = world.joint_qpos, world.joint_dof
        self._qpos, self._qvel = data.qpos, data.qvel
        self._raw, self._effort = data.sensordata, data.actuator_force
        self._imu_rotation = data.site_xmat[world.imu_site].reshape(3, 3)
        self._accelerometer = Accelerometer(period_s=period_s)
        self._period_ns = round(period_s * NANOSECONDS)
        self._past: deque[Snapshot] = deque(maxlen=delay_ticks + 1)
        self._encoders = (
            Encoders(resolution_rad=settings.encoder_resolution_rad, period_s=period_s)
            if settings.encoder_resolution_rad > 0.0
            else None
        )
        self._noise = SensorNoise(settings, seed=seed)

    def read(self, tick: int) -> Snapshot:
        """Takes one reading; to be called once per tick, in order.

        Args:
            tick: the robot's counter.

        Returns:
            What the robot reports at ``tick``; ``stamp_ns`` is simulated time.
        """
        snapshot = self._measure(tick)
        if self._past.maxlen == 1:
            return snapshot
        self._past.append(snapshot)
        return replace(self._past[0], tick=tick, stamp_ns=snapshot.stamp_ns)

    def _measure(self, tick: int) -> Snapshot:
        raw = self._raw.copy()
        q = self._qpos.take(self._joint_qpos)
        if self._encoders is None:
            dq = self._qvel.take(self._joint_dof)
        else:
            q, dq = self._encoders.read(q)
        # The accelerometer's reading takes the place of the velocity it is made of.
        raw[SENSOR_IMU_VELOCITY] = self._accelerometer.read(
            raw[SENSOR_IMU_VELOCITY], self._imu_rotation
        )
        # MuJoCo reports what the ankle does to the plate; the robot's sensor what
        # the plate does to the ankle: + z when standing.
        wrenches = raw[SENSOR_FT]
        np.negative(wrenches, out=wrenches)
        noisy = raw[SENSOR_NOISY]
        self._noise.add_to(noisy)
        return Snapshot(
            tick=tick,
            stamp_ns=tick * self._period_ns,
            q=q,
            dq=dq,
            effort=self._effort.copy(),
            quat_xyzw=xyzw(raw[SENSOR_QUAT_WXYZ]),
            angular_velocity=noisy[GYRO],
            linear_acceleration=noisy[ACCEL],
            ft_left=noisy[FT_LEFT],
            ft_right=noisy[FT_RIGHT],
        )
