"""Identifies the drives of a standing robot: lag, speed limit, delay and play.

One joint at a time is moved by a few hundredths of a radian while all others keep the
posture. The set-point of a drive shows in its torque, whatever holds the joint:

    set-point = q + (effort + kd dq) / kp

It is compared with the model of robot files: a set-point L follows the command at a
limited speed, and S follows L with a lag, S += g (L - S).

Both sides are averaged over some ticks: the difference of two positions of an encoder
is too coarse for a velocity, and a reported velocity is late by an unknown filter.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import Reference
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.qp import QpData

REST_S, SMALL_S, LARGE_S, SLOW_S = 0.2, 0.2, 0.25, 0.8
"""Times of resting, of each end of the steps, and of the slow sway [s]."""
SMALL_SHARE = 0.3
"""Small step over large one: a speed limit affects them differently, a lag does not."""
STEP_SHARE = 0.9
"""Part of the largest change of a command that the gate passes in one tick."""
LAGS_S = np.linspace(0.0, 0.06, 25)
SPEEDS_RAD_S = np.geomspace(0.8, 30.0, 22)
HALVES_RAD = np.array([0.0, 0.0003, 0.0008, 0.002, 0.005])
"""Lags, speed limits and half plays that are tried first."""
MOST_DELAY_TICKS = 6
FINER = 5
"""Rounds of the search, each around the best so far and half as wide."""
TRIED = 2
"""Number of delays that are searched closely."""
DRIVE_STEP_S = 1e-3
"""Longest step with which a drive updates its set-point [s]."""
SEEN_SHARE = 0.9
"""Part of a motion's ticks that must be answered to identify a joint's drive [1]."""
SEEN_S = 0.0025
"""Time by which a speed limit must stretch the large step to be seen [s]."""
LEAST_MOTION_RAD = 1e-3
"""Distance of set-point and joint needed to tell the stiffness [rad]."""
AVERAGE_S = 0.008
"""Time over which readings are averaged [s]."""
LIMIT_SHARE, NOISE_SHARE = 0.002, 0.1
"""Error that only a speed limit explains, from which a limit was seen: as a part of the
largest step, and of the error that nothing explains [1]."""


class Drive(msgspec.Struct, frozen=True, kw_only=True):
    """Identified properties of one drive.

    Attributes:
        joint: name of the joint.
        lag_s: lag of the set-point [s].
        velocity_limit_rad_s: largest speed that the set-point reached [rad/s].
        is_bound: whether that speed is only a lower bound: no limit was seen.
        delay_s: from the tick answered to the one in which it acts, and more [s].
        backlash_rad: play between drive and joint [rad].
        backlash_is_bound: whether that is only an upper bound: the torque kept its
            sign, and an offset of the encoder looks the same.
        stiffness_scale: true stiffness over that of the robot file; None if not seen.
        misfit_rad: root mean square error of the model [rad].
    """

    joint: str
    lag_s: float
    velocity_limit_rad_s: float
    is_bound: bool
    delay_s: float
    backlash_rad: float
    backlash_is_bound: bool
    stiffness_scale: float | None
    misfit_rad: float


class Samples(NamedTuple):
    """Commands and readings of a joint, one row per answered tick."""

    ticks: Array
    command: Array
    q: Array
    effort: Array


class IdentifyController:
    """Moves one joint after the other while the others are held; then ends.

    Attributes:
        name: name for status and results.
        is_done: whether all joints have been moved.
        on_end: called at every tick once that is so.
        failure: always None: there is no QP.
    """

    name = "identify"

    def __init__(
        self, robot: Robot, joints: Sequence[int], *, amplitude_rad: float
    ) -> None:
        """Plan the motions."""
        self._robot, self._joints = robot, list(joints)
        self._amplitude = amplitude_rad
        self._shapes = [self._motion(joint) for joint in self._joints]
        self._length = len(self._shapes[0])
        self._held: Array = np.zeros(robot.n_a)
        self._command: Array = np.zeros(robot.n_a)
        self._first_tick = 0
        self._rows: list[list[tuple[float, ...]]] = [[] for _ in self._joints]
        self.is_done = False
        self.on_end: Callable[[], None] | None = None
        self.failure: QpData | None = None

    @property
    def duration_s(self) -> float:
        """Total time of all motions [s]."""
        return len(self._joints) * self._length * self._robot.period_s

    @property
    def progress(self) -> float:
        """Part of the joints that have been moved [1]."""
        return sum(bool(rows) for rows in self._rows) / max(1, len(self._joints))

    def start(self, snapshot: Snapshot, q_command: Array) -> None:
        """Begin on a robot that stands still, from the posture it holds."""
        self._held[:] = self._command[:] = q_command
        self._first_tick = snapshot.tick

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick: one joint on its way, all others in the posture."""
        del reference
        index, at = divmod(snapshot.tick - self._first_tick, self._length)
        np.copyto(self._command, self._held)
        self.is_done = index >= len(self._joints)
        if not self.is_done:
            joint = self._joints[index]
            self._command[joint] += self._shapes[index][at]
            self._rows[index].append(
                (
                    snapshot.tick,
                    self._command.item(joint),
                    snapshot.q.item(joint),
                    snapshot.effort.item(joint),
                )
            )
        if self.is_done and self.on_end is not None:
            self.on_end()
        return ControllerOutput(self._command)

    @property
    def unseen(self) -> list[str]:
        """Return joints with too few answered ticks to identify their drives."""
        enough = SEEN_SHARE * self._length
        return [
            self._robot.joint_names[joint]
            for joint, rows in zip(self._joints, self._rows, strict=True)
            if len(rows) <= enough
        ]

    def found(self) -> list[Drive]:
        """Return the identified drives in joint order; no joint may be unseen."""
        return [
            identify(self._robot, joint, Samples(*np.array(rows).T))
            for joint, rows in zip(self._joints, self._rows, strict=True)
        ]

    def _motion(self, joint: int) -> Array:
        """Return a joint's way, as fast as the gate allows, to the roomier side."""
        robot = self._robot
        step = min(
            STEP_SHARE * robot.file.gate.step_limit_rad,
            robot.velocity_limit.item(joint) * robot.period_s,
        )
        q = robot.nominal.item(joint)
        goes_up = robot.upper[joint] - q >= q - robot.lower[joint]
        amplitude = self._amplitude if goes_up else -self._amplitude
        return motion(amplitude, largest_step=step, period_s=robot.period_s)


def motion(amplitude: float, *, largest_step: float, period_s: float) -> Array:
    """Return a joint's way from its posture and back, tick by tick, (n,) [rad].

    It is a small step and a large one, there and back, then slowly to both sides.
    """

    def stay(value: float, seconds: float) -> list[float]:
        return [value] * round(seconds / period_s)

    small = SMALL_SHARE * amplitude
    wanted = [
        *stay(0.0, REST_S),
        *(*stay(small, SMALL_S), *stay(0.0, SMALL_S)),
        *(*stay(amplitude, LARGE_S), *stay(0.0, LARGE_S)),
    ]
    way, at = [], 0.0
    for goal in wanted:
        at += min(max(goal - at, -largest_step), largest_step)
        way.append(at)
    turns = np.linspace(0.0, math.tau, round(SLOW_S / period_s))
    return np.array([*way, *(amplitude * np.sin(turns) * np.sin(0.5 * turns))])


def identify(robot: Robot, joint: int, samples: Samples) -> Drive:
    """Fit a drive's model to commands and readings.

    Args:
        robot: has the drive's gains by its file, and the length of a tick.
        joint: index of the joint, bus order.
        samples: commands and readings of its motion.
    """
    dt, kp = robot.period_s, robot.kp.item(joint)
    samples = _at_every_tick(samples)
    # A servo's velocity is the change since its own last step, so half a step old.
    late = 0.5 * min(1.0, DRIVE_STEP_S / dt)
    q = samples.q
    change = (0.5 + late) * np.diff(q, prepend=q[0])
    change += (0.5 - late) * np.diff(q, append=q[-1])
    torque = _average(samples.effort + robot.kd.item(joint) / dt * change, dt)
    fits = [
        _search(
            samples, torque, LAGS_S, SPEEDS_RAD_S, halves=HALVES_RAD, delay=delay, dt=dt
        )
        for delay in range(MOST_DELAY_TICKS + 1)
    ]
    free = min(fit.free for fit in fits)
    for best in sorted(fits)[:TRIED]:
        for width in 0.5 ** np.arange(FINER):
            lags = np.abs(best.lag + 0.004 * width * np.linspace(-1.0, 1.0, 9))
            ratios = (1.0 + 0.3 * width) ** np.linspace(-1.0, 1.0, 9)
            fit = _search(
                samples,
                torque,
                lags,
                best.speed * ratios,
                halves=best.half * (1.0 + 0.6 * width * np.linspace(-1.0, 1.0, 5)),
                delay=best.delay,
                dt=dt,
            )
            free, best = min(free, fit.free), min(best, fit)
        fits.append(best)
    best = min(fits)
    setpoint = _setpoints(
        samples.command, np.array([best.lag]), np.array([best.speed]), best.delay, dt
    )[:, 0, 0]
    distance = setpoint - samples.q
    stiffness = None
    if np.ptp(distance) > LEAST_MOTION_RAD:
        stretched = distance - np.clip(distance, -best.half, best.half)
        stiffness = float(np.polyfit(_average(stretched, dt), torque, 1)[0])
    short = _average(distance, dt) - torque / (stiffness or kp)
    rest = round(REST_S / dt * len(torque) / len(distance))
    backlash, backlash_is_bound = _play(short, torque, rest=rest)
    step = float(np.abs(samples.command - samples.command[0]).max())
    fastest = step / SEEN_S
    by_limit = math.sqrt(max(free**2 - best.misfit**2, 0.0))
    is_seen = by_limit > max(LIMIT_SHARE * step * kp, NOISE_SHARE * best.misfit)
    is_free = not is_seen or best.speed > fastest
    return Drive(
        joint=robot.joint_names[joint],
        lag_s=round(best.lag, 5),
        velocity_limit_rad_s=round(min(best.speed, fastest), 3),
        is_bound=is_free,
        delay_s=round(best.delay * dt, 6),
        backlash_rad=round(backlash, 6),
        backlash_is_bound=backlash_is_bound,
        stiffness_scale=None if stiffness is None else round(stiffness / kp, 3),
        misfit_rad=round(best.misfit / kp, 7),
    )


def _at_every_tick(samples: Samples) -> Samples:
    """Return rows for all ticks, also those without an answer or a new reading.

    The robot keeps its command until the next one. Between two readings the joint moves
    evenly.
    """
    readings = np.stack((samples.q, samples.effort))
    is_new = np.append(True, (np.diff(readings) != 0.0).any(axis=0))
    measured = samples.ticks[is_new]
    ticks = np.arange(samples.ticks[0], samples.ticks[-1] + 1.0)
    answered = np.searchsorted(samples.ticks, ticks, side="right") - 1
    return Samples(
        ticks,
        samples.command[answered],
        np.interp(ticks, measured, samples.q[is_new]),
        np.interp(ticks, measured, samples.effort[is_new]),
    )


def _average(values: Array, dt: float) -> Array:
    """Return means over blocks of ticks, the first axis."""
    size = max(1, round(AVERAGE_S / dt))
    blocks = len(values) // size
    shape = (blocks, size, *values.shape[1:])
    means: Array = values[: blocks * size].reshape(shape).mean(axis=1)
    return means


class _Fit(NamedTuple):
    """The best of some models: misfit [N m], lag [s], speed [rad/s], delay [ticks]."""

    misfit: float
    lag: float
    speed: float
    delay: int
    half: float
    """Half of the play [rad]."""
    free: float
    """Misfit of the best model without speed limit [N m]."""


def _search(
    samples: Samples,
    torque: Array,
    lags: Array,
    speeds: Array,
    *,
    halves: Array,
    delay: int,
    dt: float,
) -> _Fit:
    """Try all models, each with its best stiffness."""
    speeds = np.append(speeds, np.inf)
    away = _setpoints(samples.command, lags, speeds, delay, dt)
    away -= samples.q[:, None, None]
    centred = torque - torque.mean()
    fits = []
    for half in halves:
        # Within the play no torque passes.
        pulled = _average(away - np.clip(away, -half, half), dt)
        pulled -= pulled.mean(axis=0)
        along = np.einsum("tlv,t->lv", pulled, centred)
        square = np.einsum("tlv,tlv->lv", pulled, pulled)
        rest = centred @ centred - along**2 / np.maximum(square, 1e-12)
        misfit = np.sqrt(np.maximum(rest, 0.0) / len(torque))
        row, column = divmod(int(misfit[:, :-1].argmin()), len(speeds) - 1)
        lag, speed = float(lags[row]), float(speeds[column])
        free = float(misfit[:, -1].min())
        least = float(misfit[row, column])
        fits.append(_Fit(least, lag, speed, delay, float(half), free))
    return min(fits)


def _setpoints(
    command: Array, lags: Array, speeds: Array, delay: int, dt: float
) -> Array:
    """Return each model's set-point at each reading, (n, lags, speeds) [rad]."""
    # Drives update more often than slow robots are commanded.
    inner = max(1, round(dt / DRIVE_STEP_S))
    safe = np.maximum(lags, 1e-9)
    gain = np.where(lags > 0.0, -np.expm1(-dt / inner / safe), 1.0)[:, None]
    reach = speeds * dt / inner
    limited = np.full(len(speeds), command.item(0))
    lagged = np.full((len(lags), len(speeds)), command.item(0))
    out = np.empty((len(command), *lagged.shape))
    late = itertools.chain([command.item(0)] * delay, command.tolist())
    for row, asked in zip(out, late, strict=False):
        row[:] = lagged  # read before the tick's own command acts
        for _ in range(inner):
            limited += np.clip(asked - limited, -reach, reach)
            lagged += gain * (limited - lagged)
    return out


def _play(short: Array, torque: Array, *, rest: int) -> tuple[float, bool]:
    """Return the play of a drive [rad], and whether that is only a bound.

    The torque falls short of the set-point by half the play, towards its own side.

    Args:
        short: (n,) set-point minus the one that the torque shows [rad].
        torque: (n,) [N m].
        rest: number of readings at the beginning with the joint at rest.
    """
    least = 0.1 * float(np.abs(torque).max())
    up, down = short[torque > least], short[torque < -least]
    if len(up) > rest // 2 and len(down) > rest // 2:
        return max(0.0, float(np.median(up) - np.median(down))), False
    return 2.0 * abs(float(np.median(short[:rest]))), True
