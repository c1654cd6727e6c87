"""Gain, phase and delay margins of every foot axis, and of all of them together.

The loop is cut at the wrench errors. A factor there acts like one on 1 / |K|, which is
how much a foot yields. For the margins of one axis the other eleven stay closed. For
all axes at once there are the common factor and the common delay at which the whole
loop oscillates, and the disk margin: any factor or phase within it, different on every
axis, leaves the loop stable.

References: P. Seiler, A. Packard and P. Gahinet, An introduction to disk margins,
IEEE Control Systems Magazine 40 (2020).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
from scipy.linalg import schur, solve_triangular

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import MS_PER_S, Array, Mat
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.margins.linear_loop import LinearLoop, LoopMatrices

AXES = ("x", "y", "z", "roll", "pitch", "yaw")
FREQUENCIES = 300
LOWEST_HZ = 0.5
"""Frequency below which there is only the slow return of the feet to the stance."""
GROWTH_PER_S = 0.1
"""Growth below which a motion is no oscillation, but the feet's way along the
ground."""
MOST_TICKS = 100
LARGEST_FACTOR = 1e3
BISECTIONS = 12
BALANCING_ROUNDS = 5
ENOUGH_DB = 6.0
"""Required gain margin: the robot may yield twice as much as assumed [dB]."""


class AxisMargin(msgspec.Struct, frozen=True, kw_only=True):
    """Margins of one axis of one foot, the other axes closed; None: no limit."""

    foot: str
    """Left or right."""
    axis: str
    """Axis of the sole frame: x y z roll pitch yaw."""
    gain_db: float | None = None
    """Additional factor by which this axis may yield to a wrench error [dB]."""
    phase_deg: float | None = None
    """Change of phase that this axis bears [deg]."""
    delay_ms: float | None = None
    """Additional delay of its readings that this axis bears [ms]."""


class LoopMargins(msgspec.Struct, frozen=True, kw_only=True):
    """Margins of all axes of a robot that stands on still ground."""

    robot: str
    """Name of the robot."""
    servo_profile: str
    """Servo profile of the robot."""
    rate_hz: float
    """Control ticks per second."""
    delay_ms: float
    """Loop delay for which the margins hold: from a reading to the step in which its
    answer acts [ms]."""
    stable: bool
    """Whether it stands without oscillation; if not, the axes have no margins."""
    gain_db: float | None
    """Factor by which all axes together may yield more; negative: must yield less, to
    stand without oscillation; None: no limit [dB]."""
    disk: float
    """Disk margin of all axes together, 0 to 2 [1]."""
    disk_gain_db: float | None
    """Factor, up or down and different on every axis, that is borne; None: any [dB]."""
    disk_phase_deg: float
    """Phase, different on every axis, that is borne [deg]."""
    loop_delay_ms: float
    """Largest loop delay that is borne, a whole number of ticks; negative: none
    [ms]."""
    missed_ticks: int
    """Longest train of missed ticks that is borne if repeated without end, with one
    answered tick between trains."""
    axes: list[AxisMargin]
    """Axes of the left foot, then of the right."""

    @property
    def worst_db(self) -> float | None:
        """Smallest gain margin of single axes and of all together; None: no limit."""
        found = [axis.gain_db for axis in self.axes if axis.gain_db is not None]
        if self.gain_db is not None:
            found.append(self.gain_db)
        return min(found, default=None)

    @property
    def is_enough(self) -> bool:
        """Whether the robot stands and every gain margin is large enough."""
        worst = self.worst_db
        return self.stable and (worst is None or worst >= ENOUGH_DB)

    def in_words(self) -> list[str]:
        """Return what is borne in words, one sentence per line."""
        if not self.stable:
            return [
                f"sways at a loop delay of {self.delay_ms:g} ms: "
                + (
                    "whatever the gains"
                    if self.gain_db is None
                    else f"|K| has to grow by more than {-self.gain_db:.1f} dB"
                )
            ]
        worst = self.worst_db
        least = "no limit" if worst is None else f"{worst:.1f} dB"
        disk = "any" if self.disk_gain_db is None else f"{self.disk_gain_db:.1f} dB"
        return [
            f"least gain margin {least}"
            + ("" if self.is_enough else f", less than the {ENOUGH_DB:g} dB to have"),
            f"all axes off at once, each in its own way: {disk} or "
            f"{self.disk_phase_deg:.0f} deg (disk margin {self.disk:.2f})",
            f"bears a loop delay of {self.loop_delay_ms:g} ms, and trains of "
            f"{self.missed_ticks} missed ticks",
        ]


def compute_margins(
    robot: Robot, settings: ControllerSettings, *, delay_ticks: int = 1
) -> LoopMargins:
    """Compute all margins of the whole-body stabilizer on a robot that stands.

    ``delay_ticks`` is the delay from a reading to the step in which its answer acts.
    """
    loop = LinearLoop(robot, settings)
    period_s, matrices = loop.period_s, loop.cut(delay_ticks)
    limit = 1.0 + GROWTH_PER_S * period_s

    def is_calm(matrix: Mat) -> bool:
        return bool(np.abs(np.linalg.eigvals(matrix)).max() <= limit)

    def bears_delay(ticks: int) -> bool:
        A, B, C = loop.cut(ticks)
        return is_calm(A + B @ C)

    def bears_factor(factor: float) -> bool:
        A, B, C = matrices
        return is_calm(A + factor * B @ C)

    stable = bears_factor(1.0)
    omegas = np.geomspace(2.0 * np.pi * LOWEST_HZ, np.pi / period_s, FREQUENCIES)[:-1]
    S = _sensitivities(matrices, np.exp(1j * omegas * period_s))
    gain = _largest_factor(bears_factor)
    delay = _last_true(bears_delay, first=delay_ticks)
    disk = min(2.0, 2.0 / max(_structured_norms(2.0 * S - np.eye(12))))
    if not stable:
        disk, gain, delay = 0.0, _smaller_factor(bears_factor), -1
    axes = [
        _axis(1.0 - 1.0 / S[:, i, i], omegas, side=side, axis=axis, stable=stable)
        for i, (side, axis) in enumerate(
            (side, axis) for side in ("left", "right") for axis in AXES
        )
    ]
    return LoopMargins(
        robot=robot.file.name,
        servo_profile=robot.file.servo.profile,
        rate_hz=robot.file.rate_hz,
        delay_ms=MS_PER_S * period_s * delay_ticks,
        stable=stable,
        gain_db=_decibel(gain),
        disk=disk,
        disk_gain_db=_decibel((2.0 + disk) / (2.0 - disk)) if disk < 2.0 else None,
        disk_phase_deg=math.degrees(2.0 * math.atan(0.5 * disk)),
        loop_delay_ms=MS_PER_S * period_s * delay,
        missed_ticks=_missed(loop, delay_ticks, is_calm) if stable else 0,
        axes=axes,
    )


def _sensitivities(matrices: LoopMatrices, points: Array) -> Array:
    """Return (I - G)^-1, G from e to e, at points of the unit circle, (n, 12, 12)."""
    A, B, C = matrices
    # Delays leave no full set of eigenvectors; a triangular form always exists.
    T, Z = schur(A, output="complex")
    left, right, eye = C @ Z, Z.conj().T @ B, np.eye(len(A))
    S = np.empty((len(points), 12, 12), dtype=complex)
    for k, point in enumerate(points):
        S[k] = np.eye(12) - left @ solve_triangular(point * eye - T, right)
    inverse: Array = np.linalg.inv(S)
    return inverse


def _structured_norms(matrices: Array) -> list[float]:
    """Return upper bounds of mu for one complex number per axis, by balancing."""
    bounds = []
    for matrix in np.abs(matrices):
        scale = np.ones(12)
        for _ in range(BALANCING_ROUNDS):
            for i in range(12):
                scaled = matrix * scale[:, None] / scale
                row = math.sqrt((scaled[i] ** 2).sum() - scaled[i, i] ** 2)
                column = math.sqrt((scaled[:, i] ** 2).sum() - scaled[i, i] ** 2)
                if row > 0.0 and column > 0.0:
                    scale[i] *= math.sqrt(column / row)
        bounds.append(scale)
    scales = np.array(bounds)
    scaled = matrices * scales[:, :, None] / scales[:, None, :]
    norms: list[float] = np.linalg.norm(scaled, ord=2, axis=(1, 2)).tolist()
    return norms


def _axis(g: Array, omegas: Array, *, side: str, axis: str, stable: bool) -> AxisMargin:
    """Return the margins of one axis; g(j omega) is its loop with the others closed."""
    if not stable:
        return AxisMargin(foot=side, axis=axis)
    factors = [1.0 / real for real in _real_crossings(g) if 0.0 < real < 1.0]
    phases, delays = [], []
    size = np.abs(g)
    for k in np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) < 0.0).tolist():
        share = (1.0 - size[k]) / (size[k + 1] - size[k])
        angle = math.remainder(_between(np.angle(g), k, share), math.tau)
        omega = omegas[k] + share * (omegas[k + 1] - omegas[k])
        phases.append(abs(angle))
        delays.append(float(angle % math.tau) / float(omega))
    return AxisMargin(
        foot=side,
        axis=axis,
        gain_db=_decibel(min(factors)) if factors else None,
        phase_deg=math.degrees(min(phases)) if phases else None,
        delay_ms=MS_PER_S * min(delays) if delays else None,
    )


def _real_crossings(g: Array) -> list[float]:
    """Return the real parts of g where it crosses the real axis, and at its end."""
    imag, real = g.imag, g.real
    crossings = [float(real[-1])]
    for k in np.flatnonzero(imag[:-1] * imag[1:] < 0.0).tolist():
        share = -imag[k] / (imag[k + 1] - imag[k])
        crossings.append(float(real[k] + share * (real[k + 1] - real[k])))
    return crossings


def _between(angles: Array, k: int, share: float) -> float:
    turn = math.remainder(angles[k + 1] - angles[k], math.tau)
    return float(angles[k] + share * turn)


def _largest_factor(bears: Callable[[float], bool]) -> float:
    """Return the factor above 1 from which the loop oscillates; inf for none."""
    low, high = 1.0, 1.5
    while bears(high):
        low, high = high, 1.5 * high
        if high > LARGEST_FACTOR:
            return math.inf
    return _bisect(bears, low, high)


def _smaller_factor(bears: Callable[[float], bool]) -> float:
    """Return the factor below 1 at which an oscillating loop would be calm."""
    low, high = 1.0 / 1.5, 1.0
    while not bears(low):
        low, high = low / 1.5, low
        if low < 1.0 / LARGEST_FACTOR:
            return 0.0
    return _bisect(bears, low, high)


def _bisect(bears: Callable[[float], bool], low: float, high: float) -> float:
    for _ in range(BISECTIONS):
        middle = math.sqrt(low * high)
        if bears(middle):
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)


def _last_true(bears: Callable[[int], bool], *, first: int) -> int:
    """Return up to which number it is borne, in ever larger steps and halves of them.

    A tick more makes the loop's matrix larger, so few are asked for.
    """
    ticks, step = first, 1
    while ticks + step <= MOST_TICKS and bears(ticks + step):
        ticks, step = ticks + step, 2 * step
    while step > 1:
        step //= 2
        if ticks + step <= MOST_TICKS and bears(ticks + step):
            ticks += step
    return ticks


def _missed(loop: LinearLoop, delay_ticks: int, is_calm: Callable[[Mat], bool]) -> int:
    """Return the longest train of missed ticks that is borne, one answered between."""
    A, B, C = loop.cut(delay_ticks)
    answered = A + B @ C
    A, B, C = loop.cut(delay_ticks, missed=True)
    train, missed = answered, A + B @ C
    for count in range(MOST_TICKS):
        train = missed @ train
        if not is_calm(train):
            return count
    return MOST_TICKS


def _decibel(factor: float) -> float | None:
    if factor <= 0.0 or math.isinf(factor):
        return None
    return 20.0 * math.log10(factor)
