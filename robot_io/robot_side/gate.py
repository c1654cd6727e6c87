"""The command gate in front of the servos, shared by the simulator and any driver.

It checks each joint command from the bus: lease, age, limits and loop delay.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.mode_machine import (
    Answer,
    CommandResult,
    Limit,
    ModeMachine,
    Refusal,
)
from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    JointCommand,
    RobotMode,
    RobotStatus,
)
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.result import ModeReport

NEVER = -1
MOST_TICKS = 100_000
"""Most ticks whose start time is kept. If the robot file lets a command answer an older
tick, only ticks limit its age."""
ROUNDING_S = 1e-9
"""Tolerance by which a command may be too old, or a silence too long [s]: the last bit
must not matter."""
ROUNDING_RAD = 1e-9
"""Excess over a limit that is cut off without a report [rad]: a controller that asks
for exactly the limit must not be reported for its last bit."""
AVERAGED_OVER_S = 0.5
"""Time constant of the average [s]: long against a stall, short against a fall."""


class LoopDelay:
    """Average age of the sensors that the servos act on, over the last half second.

    An old command and a missing one do the same harm: the servos act on old sensors. So
    each tick counts the age of the sensors that the command followed in it answers,
    whenever that command came.

    Attributes:
        mean_s: the average age [s].
    """

    def __init__(self, *, period_s: float, oldest: int) -> None:
        """Begin at zero.

        Args:
            period_s: time from tick to tick [s].
            oldest: largest age that counts [ticks]. So one long silence, on which the
                watchdog acts, does not count as a slow loop.
        """
        self._period_s, self._oldest = period_s, oldest
        self._blend = period_s / AVERAGED_OVER_S
        self._answered: int | None = None
        self.mean_s = 0.0

    def restart(self) -> None:
        """Forget everything; count again from the next command on."""
        self._answered = None
        self.mean_s = 0.0

    def follow(self, answered: int) -> None:
        """Record that the servos follow a command that answers this tick's sensors."""
        self._answered = answered

    def count(self, tick: int) -> None:
        """Count the age in the tick before ``tick``, which begins now."""
        if self._answered is None:
            return
        age_s = self._period_s * min(tick - 1 - self._answered, self._oldest)
        self.mean_s += self._blend * (age_s - self.mean_s)


class CommandLimits:
    """Position, velocity and step limits of one tick's command.

    All are relative to the command of the tick before, not to the measured posture. A
    servo lags, so a limit relative to its measured position would halve the speed.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the limits of a robot."""
        margin = robot.file.gate.position_margin_rad
        self._lower = robot.lower + margin
        self._upper = robot.upper - margin
        self._by_velocity = robot.velocity_limit * robot.period_s
        self._by_step = np.full(robot.n_a, robot.file.gate.step_limit_rad)
        self._reach = robot.command_reach
        self._low, self._high, self._excess = np.empty((3, robot.n_a))

    def clip(self, wanted: Array, before: Array, *, out: Array) -> tuple[Limit, ...]:
        """Move from one posture toward another within the limits.

        Args:
            wanted: (n_a,) wanted posture, finite [rad].
            before: (n_a,) command of the tick before [rad].
            out: (n_a,) receives the allowed posture [rad]: at most one step from
                ``before``, and inside the range whenever ``before`` is.

        Returns:
            The limits that cut something off.
        """
        np.maximum(wanted, self._lower, out=out)
        np.minimum(out, self._upper, out=out)
        np.subtract(before, self._reach, out=self._low)
        np.add(before, self._reach, out=self._high)
        np.maximum(out, self._low, out=out)
        np.minimum(out, self._high, out=out)
        if out.tobytes() == wanted.tobytes():  # nearly always; the fastest to ask
            return ()
        np.abs(wanted - out, out=self._excess)
        if self._excess.max() <= ROUNDING_RAD:
            return ()
        inside = np.clip(wanted, self._lower, self._upper)
        move = np.abs(inside - before) - ROUNDING_RAD
        found = {
            Limit.POSITION: np.abs(wanted - inside) > ROUNDING_RAD,
            Limit.VELOCITY: move > self._by_velocity,
            Limit.STEP: move > self._by_step,
        }
        return tuple(limit for limit, joints in found.items() if joints.any())

    def worst_joint(self) -> tuple[int, float]:
        """Return the joint cut most in the last clip, and its excess [rad]."""
        index = int(self._excess.argmax())
        return index, float(self._excess[index])


class CommandGate:
    """Passes only commands that are safe to follow, and reports why it refuses others.

    It is pure: no clock and no I/O; times are arguments on one monotonic scale. At each
    tick of the robot::

        gate.begin_tick(now_s=now, tick=tick)                    # watchdog
        result = gate.accept(command, tick=tick, now_s=now)      # any number of them
        follow(result.posture)

    However many commands come within a tick, the posture moves by at most one tick's
    step. When the commander falls silent, the gate holds the last posture. The same
    commander may go on from there until the silence becomes a fault. A loop whose
    answers are too late on average to balance with is a fault, too. A command beyond a
    limit is clipped, refused, or in ``warn_only`` followed and counted, as the robot
    file says.

    Attributes:
        modes: mode, its cause, notices and lease.
        refused: refused commands by reason.
        clipped: clipped commands by limit.
        delay: average age of the sensors that the servos act on.
    """

    def __init__(self, robot: Robot, posture: Array) -> None:
        """Start in HOLD.

        Args:
            robot: the robot of the files.
            posture: (n_a,) present posture of the servos, held until commanded [rad].
        """
        self.modes = ModeMachine(lease_s=robot.file.gate.lease_s)
        self.refused: Counter[str] = Counter()
        self.clipped: Counter[str] = Counter()
        self._settings = robot.file.gate
        self._names = robot.joint_names
        age_s = self._settings.max_command_age_s
        self._max_age_s = self._settings.hold_after_s if age_s is None else age_s
        self._oldest = math.ceil(self._max_age_s / robot.period_s)
        self._began = [(NEVER, 0.0)] * min(self._oldest + 1, MOST_TICKS)
        """Start of each recent tick, at tick modulo its length: (tick, time [s])."""
        self.delay = LoopDelay(period_s=robot.period_s, oldest=self._oldest)
        self._limits = CommandLimits(robot)
        self._posture = _fixed(np.array(posture, dtype=np.float64))
        self._before = self._posture
        self._wanted, self._allowed = np.array((posture, posture), dtype=np.float64)
        self._seen_mode, self._mode_since_s = self.modes.mode, 0.0
        self._now_s = 0.0
        self._sequence = -1
        self._heard_s = 0.0
        self._is_commanded = self._is_first = False

    @property
    def mode(self) -> RobotMode:
        """Present mode."""
        return self.modes.mode

    @property
    def posture(self) -> Array:
        """(n_a,) posture that the servos follow at present [rad]; read-only.

        Each accepted command replaces the array.
        """
        return self._posture

    def request(self, action: str, who: str, *, now_s: float) -> Answer:
        """Change mode or lease; see :meth:`ModeMachine.request`."""
        holder, mode = self.modes.lease.holder, self.mode
        answer = self.modes.request(action, who, now_s=now_s)
        if self.modes.lease.holder != holder:
            self._sequence = -1
        if self.mode is not mode:
            self._is_first = self.mode is RobotMode.ACTIVE
            self._is_commanded = False
            self._heard_s = now_s
            self.delay.restart()
        return answer

    def begin_tick(self, *, now_s: float, tick: int | None = None) -> None:
        """Begin a tick: check watchdog, loop delay and lease.

        Args:
            now_s: the robot's time; never goes back [s].
            tick: the tick. With it, the age of commands that answer this tick is also
                measured in time, since ticks of a late loop hide it, and the loop's
                delay is watched. None: neither is done.
        """
        if tick is not None:
            self._began[tick % len(self._began)] = (tick, now_s)
        self._before = self._posture
        if self._listens():
            self._watch(now_s - self._heard_s - ROUNDING_S)
        if tick is not None and self.mode is RobotMode.ACTIVE:
            self._watch_delay(tick)
        lease = self.modes.lease
        if lease.has_expired(now_s=now_s):
            self.modes.lose(
                ModeCause.LEASE_EXPIRED, f"{lease.holder} let its lease expire"
            )
        self._now_s = now_s
        if self.mode is not self._seen_mode:
            self._seen_mode, self._mode_since_s = self.mode, now_s

    def accept(
        self, command: JointCommand, *, tick: int, now_s: float
    ) -> CommandResult:
        """Judge a command, and return what the servos are to follow now.

        Args:
            command: command from the bus or from a controller in this process.
            tick: the newest tick that can have been answered.
            now_s: the robot's time [s].

        Returns:
            The outcome; refused and clipped commands are counted.
        """
        refusal = self._why_not_heard(command, tick=tick, now_s=now_s)
        refusal = refusal or self._why_not_from_here()
        if refusal is not None:
            return CommandResult(command.tick, self._posture, refusal)
        clipped = self._limits.clip(self._wanted, self._before, out=self._allowed)
        self.clipped.update(clipped)
        settings = self._settings
        if clipped and settings.beyond_limits == "refuse" and not settings.warn_only:
            refusal = self.refuse(Refusal.LIMIT, self._excess(clipped))
            return CommandResult(command.tick, self._posture, refusal)
        self._follow(clipped, now_s)
        self.delay.follow(command.tick)
        return CommandResult(command.tick, self._posture)

    def refuse(self, refusal: Refusal, detail: str) -> Refusal:
        """Count and report a refusal, also of a command that could not be read."""
        self.refused[refusal] += 1
        self.modes.notice = f"command refused ({refusal}): {detail}"
        return refusal

    def status(
        self, *, tick: int, stamp_ns: int, now_s: float, deadline_misses: int
    ) -> RobotStatus:
        """Return the status to publish."""
        modes = self.modes
        return RobotStatus(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            mode=modes.mode,
            cause=modes.cause,
            detail=modes.detail,
            notice=modes.notice,
            commander=modes.lease.holder,
            command_age_s=now_s - self._heard_s if self._is_commanded else -1.0,
            q_command=self._posture.tolist(),
            refused=dict(self.refused),
            clipped=dict(self.clipped),
            deadline_misses=deadline_misses,
        )

    def report(self) -> ModeReport:
        """Return the present mode, its cause, and its start."""
        modes = self.modes
        return ModeReport(
            mode=modes.mode,
            cause=modes.cause,
            detail=modes.detail,
            since_s=self._mode_since_s
            if self.mode is self._seen_mode
            else self._now_s,  # it changed within this tick
        )

    def _why_not_heard(
        self, command: JointCommand, *, tick: int, now_s: float
    ) -> Refusal | None:
        """Return why a command is refused for its sender, form, order, mode or age."""
        if not self.modes.holds_lease(command.commander):
            return self.refuse(Refusal.LEASE, self.modes.why_not(command.commander))
        refusal = self._why_no_posture(command.q)
        if refusal is not None:
            return refusal  # and its sequence is not believed either
        if command.sequence <= self._sequence:
            detail = f"got {command.sequence} after {self._sequence}"
            return self.refuse(Refusal.SEQUENCE, detail)
        self._sequence = command.sequence
        if not self._listens():
            return self.refuse(Refusal.MODE, f"the robot is in mode {self.mode}")
        age = tick - command.tick
        if not 0 <= age <= self._oldest:
            refusal = Refusal.LATE if age > 0 else Refusal.FUTURE
            return self.refuse(refusal, f"answers tick {command.tick} at tick {tick}")
        began_tick, began_s = self._began[command.tick % len(self._began)]
        age_s = now_s - began_s
        if began_tick == command.tick and age_s > self._max_age_s + ROUNDING_S:
            return self.refuse(Refusal.LATE, f"answers sensors {age_s:.3f} s old")
        return None

    def _why_no_posture(self, q: list[float]) -> Refusal | None:
        """Return why numbers are no joint positions; keep them if they are."""
        if len(q) != len(self._names):
            detail = f"got {len(q)} numbers, expected {len(self._names)}"
            return self.refuse(Refusal.SIZE, detail)
        if not math.isfinite(sum(q)):
            return self.refuse(Refusal.NOT_FINITE, "NaN or infinity in q")
        self._wanted[:] = q
        return None

    def _why_not_from_here(self) -> Refusal | None:
        """Return why the wanted posture cannot be followed from the held one."""
        if self._is_first or self.modes.is_silent:
            far = np.abs(self._wanted - self._posture)
            tolerance = self._settings.first_command_tolerance_rad
            if far.max() > tolerance:
                detail = (
                    f"{self._names[int(far.argmax())]} is {far.max():.4f} rad from "
                    f"the held posture, at most {tolerance:g} allowed; start from "
                    "what the robot holds"
                )
                return self.refuse(Refusal.FIRST_COMMAND, detail)
        return None

    def _follow(self, clipped: tuple[Limit, ...], now_s: float) -> None:
        """Follow the wanted posture, within the limits that clipped it."""
        if self.modes.is_silent:
            self.modes.go_on()
        self._is_first = False
        self._is_commanded = True
        self._heard_s = now_s
        self.modes.lease.renew(now_s=now_s)
        follows_all = bool(clipped) and self._settings.warn_only
        self._posture = _fixed((self._wanted if follows_all else self._allowed).copy())
        if clipped:
            done = "followed beyond its limits" if follows_all else "clipped"
            self.modes.notice = f"command {done}: {self._excess(clipped)}"

    def _excess(self, limits: tuple[Limit, ...]) -> str:
        """Return the exceeded limits and the largest excess, in words."""
        joint, excess = self._limits.worst_joint()
        return f"{', '.join(limits)}: {self._names[joint]} by {excess:.4f} rad"

    def _listens(self) -> bool:
        return self.mode is RobotMode.ACTIVE or self.modes.is_silent

    def _watch(self, silence_s: float) -> None:
        """Act on the commander's silence; before its first command it may be busy."""
        settings = self._settings
        if self._is_first:
            if silence_s > settings.fault_after_s:
                self._is_first = False
                self.modes.hold(
                    ModeCause.NO_FIRST_COMMAND,
                    f"no command in {silence_s:.3f} s after enabling",
                )
        elif silence_s > settings.fault_after_s:
            self.modes.fail(ModeCause.SILENCE, f"no command for {silence_s:.3f} s")
        elif silence_s > settings.hold_after_s and self.mode is RobotMode.ACTIVE:
            self.modes.hold_for_silence(f"no command for {silence_s:.3f} s")

    def _watch_delay(self, tick: int) -> None:
        """Act on a loop that is too slow, although never silent."""
        self.delay.count(tick)
        limit_s = self._settings.max_loop_delay_s
        if limit_s is not None and self.delay.mean_s > limit_s:
            self.modes.fail(
                ModeCause.LOOP_TOO_SLOW,
                f"commands answered sensors over {1e3 * limit_s:g} ms old on average: "
                "the loop is too slow",
            )


def _fixed(posture: Array) -> Array:
    """Return the same array, made read-only."""
    posture.setflags(write=False)
    return posture
