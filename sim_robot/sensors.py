"""The simulated sensors: turn MuJoCo's true state into the robot's readings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import GRAVITY_M_S2, Array, Mat, Vec3
from surefoot.schemas.messages import JointState
from surefoot.schemas.robot_file import VirtualForceTorque
from surefoot.schemas.scenario_robot import Delay, Sensors
from surefoot.schemas.sensors import SENSORS, Noise, Sensor
from surefoot.sim_robot.conventions import SIM_STEP_S, xyzw
from surefoot.sim_robot.robot_spec import (
    ATTITUDE,
    SENSOR_NOISY,
    SENSOR_PLACES,
    SENSOR_WRENCHES,
    UNITS,
)
from surefoot.sim_robot.sensor_lines import (
    IMU,
    JOINTS,
    KINDS,
    kind_of,
    sensor_lines,
)
from surefoot.sim_robot.world import World

NANOSECONDS = 1_000_000_000
SECONDS_PER_MINUTE = 60.0
EFFORT_STREAM = 100
"""Number of the random stream of joint efforts."""
BLOCK_ROWS = 256
"""Ticks drawn at a time; the random streams do not depend on it."""
CHANNELS = SENSOR_NOISY.stop - SENSOR_NOISY.start
VELOCITY_FILTER_S = 0.005
"""Time constant of the low-pass on the difference of two positions [s]."""


class Accelerometer:
    """Mean specific force since the last reading, in the frame of this reading.

    R a_k = (v_k - v_(k-1)) / period - g holds exactly: integrating the readings gives
    the true velocity. (MuJoCo's own sensor reports the acceleration before the servos'
    implicit damping, some per cent off the true one.)
    """

    def __init__(self, *, period_s: float, gravity: float = GRAVITY_M_S2) -> None:
        """Start at rest: the first reading is gravity alone.

        Args:
            period_s: time from tick to tick [s].
            gravity: magnitude of gravity [m/s^2].
        """
        self._rate = 1.0 / period_s
        self._gravity = gravity
        self._last: Vec3 = np.zeros(3)
        self._started = False
        self._force_in_world: Array = np.empty(3)

    def read(self, velocity: Vec3, rotation: Mat, *, ticks: int = 1) -> Vec3:
        """Read the sensor once.

        Args:
            velocity: (3,) velocity of the sensor in the world [m/s].
            rotation: (3, 3) world from sensor.
            ticks: ticks since the last reading.

        Returns:
            (3,) specific force in the sensor's frame [m/s^2]; +g upwards at rest.
        """
        force = self._force_in_world
        if not self._started:
            self._last[:] = velocity
            self._started = True
        np.subtract(velocity, self._last, out=force)
        force *= self._rate / ticks
        force[2] += self._gravity
        self._last[:] = velocity
        specific_force: Vec3 = force @ rotation
        return specific_force


class Encoders:
    """Rounds positions to the encoder's steps and differentiates the rounded ones.

    Velocity: first-order low-pass of (q_k - q_(k-1)) / period, discretised exactly.
    """

    def __init__(self, *, resolution_rad: float, period_s: float) -> None:
        """Start without earlier readings: the first velocity is zero.

        Args:
            resolution_rad: one encoder step [rad]; greater than zero.
            period_s: time from tick to tick [s].
        """
        self._resolution = resolution_rad
        self._period = period_s
        self._last: Array | None = None
        self._velocity: Array | None = None

    def read(self, q: Array, *, ticks: int = 1) -> tuple[Array, Array]:
        """Read the encoders once.

        Args:
            q: (n_a,) true positions [rad].
            ticks: ticks since the last reading.

        Returns:
            (n_a,) rounded positions [rad] and (n_a,) filtered velocities [rad/s],
            both new arrays.
        """
        rounded = np.rint(q / self._resolution) * self._resolution
        if self._last is None or self._velocity is None:
            velocity = np.zeros_like(rounded)
        else:
            elapsed = self._period * ticks
            gain = -math.expm1(-elapsed / VELOCITY_FILTER_S)
            difference = (rounded - self._last) / elapsed
            velocity = self._velocity + gain * (difference - self._velocity)
        self._last, self._velocity = rounded, velocity
        return rounded, velocity


class SensorNoise:
    """Scale, offset, drift and Gaussian noise of every axis of every noisy sensor.

    Each sensor's stream advances by one standard normal number per axis and tick, for
    any settings. So one setting never shifts another's numbers.
    """

    def __init__(
        self, settings: Sensors, *, seed: int, period_s: float = SIM_STEP_S
    ) -> None:
        """Start the streams.

        Args:
            settings: standard deviations, scales, offsets and drifts.
            period_s: time from tick to tick [s].
            seed: seed of the run; each sensor gets its own child.
        """
        streams = _streams()
        children = np.random.SeedSequence(seed).spawn(max(streams) + 1)
        self._streams = [
            (np.random.default_rng(children[number]), channels)
            for number, channels in streams.items()
        ]
        self._deviation, self._bias = np.zeros(CHANNELS), np.zeros(CHANNELS)
        self._scale, self._drift = np.ones(CHANNELS), np.zeros(CHANNELS)
        for entry, noise, channels in _noises():
            for values, key in (
                (self._deviation, noise.deviation),
                (self._bias, noise.bias),
                (self._scale, noise.scale),
                (self._drift, noise.drift),
            ):
                values[channels] = settings.axes(key, entry.side)
        self._drift *= period_s / SECONDS_PER_MINUTE
        self._scales = bool((self._scale != 1.0).any())
        self._drifts = bool(self._drift.any())
        self._silent = not self._deviation.any() and not self._bias.any()
        self._rows = np.zeros((BLOCK_ROWS, CHANNELS))
        self._next = BLOCK_ROWS

    def add_to(self, readings: Array, *, tick: int) -> None:
        """Disturb the readings of one tick in place; called once per tick, in order.

        Args:
            readings: (CHANNELS,) the noisy part of MuJoCo's sensor array.
            tick: the robot's tick counter.
        """
        if self._scales:
            readings *= self._scale
        if self._drifts:
            readings += tick * self._drift
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


def _noises() -> Iterator[tuple[Sensor, Noise, slice]]:
    """Yield sensor, noise and channels of every noisy quantity."""
    for entry in SENSORS:
        for quantity in entry.quantities:
            if quantity.noise is not None:
                place = SENSOR_PLACES[entry.name, quantity.attribute]
                begin = place.start - SENSOR_NOISY.start
                yield entry, quantity.noise, slice(begin, begin + quantity.size)


def _streams() -> dict[int, slice]:
    """Return the channels of each stream, which draws them as one row."""
    streams: dict[int, slice] = {}
    for _, noise, channels in _noises():
        begin = streams.get(noise.stream, channels).start
        streams[noise.stream] = slice(begin, channels.stop)
    return streams


class SensorSuite:
    """Reads all sensors of a tick: errors, resolution, rates and delays.

    Joint positions, velocities, attitude and gyroscope are those of the tick. Wrenches
    and efforts are those of the simulation step that led to it. The accelerometer
    reports the mean since its last reading. The attitude is the true one, without
    noise. Each sensor has its own random numbers.
    """

    def __init__(
        self,
        world: World,
        data: mujoco.MjData,
        *,
        settings: Sensors,
        delay: Delay,
        encoder_offset: Array,
        period_s: float,
        seed: int,
        virtual: VirtualForceTorque | None = None,
    ) -> None:
        """Set up the sensors.

        Args:
            world: has the places of the readings.
            data: the state to read from then on.
            settings: sensor settings of the scenario.
            delay: delays of the scenario.
            encoder_offset: (n_a,) reading minus true position [rad].
            period_s: control period [s].
            seed: seed of the run; equal seeds give equal noise.
            virtual: settings of a robot without ankle sensors, whose readings are zero.

        Raises:
            ScenarioError: a delay is no whole number of ticks, or a rate is above the
                robot's.
        """
        self._joint_qpos, self._joint_dof = world.joint_qpos, world.joint_dof
        self._qpos, self._qvel = data.qpos, data.qvel
        self._raw, self._effort = data.sensordata, data.actuator_force
        self._accelerometers = [
            (
                Accelerometer(period_s=period_s, gravity=world.gravity),
                SENSOR_PLACES[unit.name, "linear_acceleration"],
                data.site_xmat[world.sensor_sites[unit.name]].reshape(3, 3),
            )
            for unit in UNITS
        ]
        self._period_ns = round(period_s * NANOSECONDS)
        self._offset = encoder_offset if encoder_offset.any() else None
        self._lines = sensor_lines(settings, delay, period_s=period_s, seed=seed)
        self._measured: dict[str, int] = {}
        self._encoders = (
            Encoders(resolution_rad=settings.encoder_resolution_rad, period_s=period_s)
            if settings.encoder_resolution_rad > 0.0
            else None
        )
        self._noise = SensorNoise(settings, seed=seed, period_s=period_s)
        self._virtual = virtual
        self._kd = -world.model.actuator_biasprm[:, 2]
        self._dq_before = self._qvel.take(self._joint_dof)
        children = np.random.SeedSequence(seed, spawn_key=(EFFORT_STREAM,))
        self._effort_stream = np.random.default_rng(children)

    def read(self, tick: int) -> Snapshot:
        """Take one reading; call it once per tick, in order.

        Returns:
            The robot's readings at ``tick``; ``stamp_ns`` is simulated time.
        """
        if not self._lines:
            return self._measure(tick)
        due = [line for line in self._lines if line.is_due(tick)]
        fresh = self._measure(tick, due=[line.kind for line in due])
        for line in due:
            line.take(fresh)
        reported: dict[str, Any] = {}
        ticks: dict[str, int] = {}
        for line in self._lines:
            then = line.report(tick)
            reported.update((field, getattr(then, field)) for field in line.fields)
            ticks[line.kind] = then.tick
        measured = tuple([self._period_ns * ticks[kind_of(s)] for s in SENSORS])
        return replace(fresh, **reported, measured_ns=measured)

    def begin_step(self) -> None:
        """Before a step, keep the speeds that its efforts will contain."""
        if self._virtual is not None:
            self._qvel.take(self._joint_dof, out=self._dq_before)

    def _measure(self, tick: int, due: Sequence[str] = KINDS) -> Snapshot:
        """Measure the kinds that are due; other fields have no meaning."""
        raw = self._raw.copy()
        q = self._qpos.take(self._joint_qpos)
        if self._offset is not None:
            q += self._offset
        if self._encoders is None or JOINTS not in due:
            dq = self._qvel.take(self._joint_dof)
        else:
            q, dq = self._encoders.read(q, ticks=self._since(JOINTS, tick))
        if IMU in due:
            ticks = self._since(IMU, tick)
            # Each reading replaces the velocity that it is computed from.
            for accelerometer, place, rotation in self._accelerometers:
                raw[place] = accelerometer.read(raw[place], rotation, ticks=ticks)
        # MuJoCo reports the wrench of the ankle on the plate; the robot's sensor that
        # of the plate on the ankle: +z when standing.
        wrenches = raw[SENSOR_WRENCHES]
        np.negative(wrenches, out=wrenches)
        self._noise.add_to(raw[SENSOR_NOISY], tick=tick)
        effort = self._effort.copy()
        if self._virtual is not None:
            wrenches[:] = 0.0
            # Damping acts with the speed at the end of the step, but MuJoCo reports it
            # with the speed at its beginning.
            dq_now = self._qvel.take(self._joint_dof)
            effort -= self._kd * (dq_now - self._dq_before)
            noise = self._effort_stream.standard_normal(effort.size)
            effort += self._virtual.effort_noise_nm * noise
        fields: list[Any] = [
            xyzw(raw[place]) if is_attitude else raw[place]
            for place, is_attitude in _FIELDS
        ]
        return Snapshot(tick, tick * self._period_ns, q, dq, effort, *fields)

    def _since(self, kind: str, tick: int) -> int:
        """Return ticks since the last reading of a kind, 1 at first; it is read now."""
        before = self._measured.get(kind, tick - 1)
        self._measured[kind] = tick
        return tick - before


def _places_of_fields() -> Iterator[tuple[slice, bool]]:
    """Find each field of the snapshot, after the joints', in MuJoCo's sensor array.

    Yields:
        Its slice, and whether it is an attitude, which MuJoCo orders w x y z.
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
