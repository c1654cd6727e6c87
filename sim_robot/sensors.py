"""The robot's sensors: truth in, what the robot reports out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.messages import JointState
from surefoot.schemas.scenario import Sensors
from surefoot.schemas.sensors import SENSORS, Noise
from surefoot.sim_robot.motion import GRAVITY_M_S2
from surefoot.sim_robot.quaternion import xyzw
from surefoot.sim_robot.robot_spec import (
    ATTITUDE,
    SENSOR_NOISY,
    SENSOR_PLACES,
    SENSOR_WRENCHES,
    UNITS,
)
from surefoot.sim_robot.world import World

NANOSECONDS = 1_000_000_000
BLOCK_ROWS = 256
"""Ticks drawn at a time; the streams do not depend on it."""
CHANNELS = SENSOR_NOISY.stop - SENSOR_NOISY.start
VELOCITY_FILTER_S = 0.005
"""Time constant of the low-pass behind the difference of two positions [s]."""


class Accelerometer:
    """Mean specific force since the last reading, in the frame of this reading.

    R a_k = (v_k - v_(k-1)) / period - g holds exactly: integrating the readings
    gives the true velocity. (The simulator's own sensor reports the acceleration
    before the implicit damping of the servos, some per cent off the true one.)
    """

    def __init__(self, *, period_s: float) -> None:
        """Start at rest: the first reading is gravity alone.

        Args:
            period_s: time between readings.
        """
        self._rate = 1.0 / period_s
        self._last: Vec3 = np.zeros(3)
        self._started = False
        self._force_in_world: Array = np.empty(3)

    def read(self, velocity: Vec3, rotation: Mat) -> Vec3:
        """Read the sensor once per tick.

        Args:
            velocity: (3,) of the sensor in the world [m/s].
            rotation: (3, 3) world from sensor.

        Returns:
            (3,) specific force in the sensor's frame [m/s^2]; + g upwards at rest.
        """
        force = self._force_in_world
        if not self._started:
            self._last[:] = velocity
            self._started = True
        np.subtract(velocity, self._last, out=force)
        force *= self._rate
        force[2] += GRAVITY_M_S2
        self._last[:] = velocity
        specific_force: Vec3 = force @ rotation
        return specific_force


class Encoders:
    """Rounds positions to the encoder's steps and differentiates what is left.

    Velocity: first-order low-pass of (q_k - q_(k-1)) / period, discretised exactly.
    """

    def __init__(self, *, resolution_rad: float, period_s: float) -> None:
        """Start without a past: the first velocity is zero.

        Args:
            resolution_rad: one encoder step; greater than zero.
            period_s: time between readings.
        """
        self._resolution = resolution_rad
        self._period = period_s
        self._gain = -math.expm1(-period_s / VELOCITY_FILTER_S)
        self._last: Array | None = None
        self._velocity: Array | None = None

    def read(self, q: Array) -> tuple[Array, Array]:
        """Read the encoders once per tick.

        Args:
            q: (n_a,) true positions [rad].

        Returns:
            (n_a,) rounded positions [rad] and (n_a,) filtered velocities [rad/s],
            both new arrays.
        """
        rounded = np.rint(q / self._resolution) * self._resolution
        if self._last is None or self._velocity is None:
            velocity = np.zeros_like(rounded)
        else:
            difference = (rounded - self._last) / self._period
            velocity = self._velocity + self._gain * (difference - self._velocity)
        self._last, self._velocity = rounded, velocity
        return rounded, velocity


class SensorNoise:
    """Gaussian noise plus a constant bias, on every axis of every noisy sensor.

    Each sensor's stream advances by one standard normal number per axis and tick,
    whatever the settings, so that one setting never shifts another's numbers.
    """

    def __init__(self, settings: Sensors, *, seed: int) -> None:
        """Start the streams.

        Args:
            settings: standard deviations and biases.
            seed: of the run; each sensor gets a child of its own.
        """
        streams = _streams()
        children = np.random.SeedSequence(seed).spawn(max(streams) + 1)
        self._streams = [
            (np.random.default_rng(children[number]), channels)
            for number, channels in streams.items()
        ]
        self._deviation, self._bias = np.zeros(CHANNELS), np.zeros(CHANNELS)
        for noise, channels in _noises():
            self._deviation[channels] = getattr(settings, noise.deviation)
            self._bias[channels] = getattr(settings, noise.bias)
        self._silent = not self._deviation.any() and not self._bias.any()
        self._rows = np.zeros((BLOCK_ROWS, CHANNELS))
        self._next = BLOCK_ROWS

    def add_to(self, readings: Array) -> None:
        """Disturb the readings of one tick in place.

        Args:
            readings: (CHANNELS,) the noisy part of MuJoCo's sensor array.
        """
        if self._silent:
            return
        if self._next == BLOCK_ROWS:
            self._draw()
        readings += self._rows[self._next]
        self._next += 1

    def _draw(self) -> None:
        for generator, channels in self._streams:
            block = self._rows[:, channels]
            block[:] = generator.standard_normal(block.shape)
        self._rows *= self._deviation
        self._rows += self._bias
        self._next = 0


def _noises() -> Iterator[tuple[Noise, slice]]:
    """The noise of every noisy quantity, and its channels."""
    for entry in SENSORS:
        for quantity in entry.quantities:
            if quantity.noise is not None:
                place = SENSOR_PLACES[entry.name, quantity.attribute]
                begin = place.start - SENSOR_NOISY.start
                yield quantity.noise, slice(begin, begin + quantity.size)


def _streams() -> dict[int, slice]:
    """Channels by stream: a row of a stream is drawn at a time."""
    streams: dict[int, slice] = {}
    for noise, channels in _noises():
        begin = streams.get(noise.stream, channels).start
        streams[noise.stream] = slice(begin, channels.stop)
    return streams


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
        """Set up the sensors.

        Args:
            world: where the readings are.
            data: the state to read, from then on.
            settings: noise, biases and resolution of the scenario.
            period_s: control period.
            delay_ticks: age of what a snapshot reports.
            seed: of the run; equal seeds give equal noise.
        """
        self._joint_qpos, self._joint_dof = world.joint_qpos, world.joint_dof
        self._qpos, self._qvel = data.qpos, data.qvel
        self._raw, self._effort = data.sensordata, data.actuator_force
        self._accelerometers = [
            (
                Accelerometer(period_s=period_s),
                SENSOR_PLACES[unit.name, "linear_acceleration"],
                data.site_xmat[world.sensor_sites[unit.name]].reshape(3, 3),
            )
            for unit in UNITS
        ]
        self._period_ns = round(period_s * NANOSECONDS)
        self._past: deque[Snapshot] = deque(maxlen=delay_ticks + 1)
        self._encoders = (
            Encoders(resolution_rad=settings.encoder_resolution_rad, period_s=period_s)
            if settings.encoder_resolution_rad > 0.0
            else None
        )
        self._noise = SensorNoise(settings, seed=seed)

    def read(self, tick: int) -> Snapshot:
        """Take one reading; to be called once per tick, in order.

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
        # An accelerometer's reading takes the place of the velocity it is made of.
        for accelerometer, place, rotation in self._accelerometers:
            raw[place] = accelerometer.read(raw[place], rotation)
        # MuJoCo reports what the ankle does to the plate; the robot's sensor what
        # the plate does to the ankle: + z when standing.
        wrenches = raw[SENSOR_WRENCHES]
        np.negative(wrenches, out=wrenches)
        self._noise.add_to(raw[SENSOR_NOISY])
        return Snapshot(
            tick,
            tick * self._period_ns,
            q,
            dq,
            self._effort.copy(),
            *[
                xyzw(raw[place]) if is_attitude else raw[place]
                for place, is_attitude in _FIELDS
            ],
        )


def _places_of_fields() -> Iterator[tuple[slice, bool]]:
    """Where MuJoCo has each field of the snapshot after the joints', and its order.

    Yields:
        The place, and whether it is an attitude, which MuJoCo writes w x y z.
    """
    joints, *others = SENSORS
    assert joints.message is JointState
    for entry in others:
        for field in entry.fields:
            places = [
                SENSOR_PLACES[entry.name, quantity.attribute]
                for quantity in entry.quantities
                if quantity.field == field
            ]
            is_attitude = places == [SENSOR_PLACES.get((entry.name, ATTITUDE[0]))]
            yield slice(places[0].start, places[-1].stop), is_attitude


_FIELDS = tuple(_places_of_fields())
