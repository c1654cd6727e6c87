"""The guard in front of the servos, shared by the simulator and any driver."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from robot_io.authority import Authority
from robot_io.limits import CommandLimits
from robot_io.loop_delay import LoopDelay
from robot_io.robot import Robot
from robot_io.verdict import Answer, Limit, Refusal, Verdict
from schemas.arrays import Array
from schemas.messages import SCHEMA_VERSION, JointCommand, RobotMode, RobotStatus

_ACCEPTED = Verdict(accepted=True)
NEVER = -1
ROUNDING_S = 1e-9
"""A command exactly as old as allowed must not be refused for its last bit."""


class CommandGate:
    """Lets a command through only when it is safe to follow; says why when not.

    Pure: no clock and no I/O, time is passed in on one monotonic scale. At each tick
    of the robot::

        gate.begin_tick(now_s=now, tick=tick)       # watchdog
        gate.check(command, tick=tick, now_s=now)   # any number of commands
        follow(gate.posture)

    However many commands come within a tick, the posture moves by one tick's step at
    most. When the commander falls silent the gate holds the last posture; the same
    commander may go on from there, until the silence has become a fault. So has a loop
    that answers, but too late on average to balance with. What goes
    beyond a limit is clipped to it, refused, or in ``warn_only`` followed and counted,
    as the robot file says.

    Attributes:
        authority: mode, fault, reason and lease.
        refused: refused commands by reason.
        clipped: clipped commands by limit.
        delay: average age of what the servos follow.
    """

    def __init__(self, robot: Robot, posture: Array) -> None:
        """Starts in HOLD.

        Args:
            robot: what its files say.
            posture: (n_a,) where the servos are now, held until commanded [rad].
        """
        self.authority = Authority(lease_s=robot.file.gate.lease_s)
        self.refused: Counter[str] = Counter()
        self.clipped: Counter[str] = Counter()
        self._settings = robot.file.gate
        self._names = robot.joint_names
        age_s = self._settings.max_command_age_s
        self._max_age_s = self._settings.hold_after_s if age_s is None else age_s
        self._oldest = math.ceil(self._max_age_s / robot.period_s)
        self._began = [(NEVER, 0.0)] * (self._oldest + 1)
        """When the last ticks began, by tick modulo its length: (tick, time [s])."""
        self.delay = LoopDelay(period_s=robot.period_s, oldest=self._oldest)
        self._limits = CommandLimits(robot)
        self._posture = np.array(posture, dtype=np.float64)
        self._before = self._posture.copy()
        self._wanted = self._posture.copy()
        self._allowed = self._posture.copy()
        self._visible = self._posture.view()
        self._visible.setflags(write=False)
        self._sequence = -1
        self._heard_s = 0.0
        self._is_commanded = False
        self._is_first = False

    @property
    def mode(self) -> RobotMode:
        """Present mode."""
        return self.authority.mode

    @property
    def posture(self) -> Array:
        """(n_a,) what the servos follow [rad]; changes in place, not to be written."""
        return self._visible

    def request(self, action: str, who: str, *, now_s: float) -> Answer:
        """Changes mode or lease; see :meth:`Authority.request`."""
        holder, mode = self.authority.lease.holder, self.mode
        answer = self.authority.request(action, who, now_s=now_s)
        if self.authority.lease.holder != holder:
            self._sequence = -1
        if self.mode is not mode:
            self._is_first = self.mode is RobotMode.ACTIVE
            self._is_commanded = False
            self._heard_s = now_s
            self.delay.restart()
        return answer

    def begin_tick(self, *, now_s: float, tick: int | None = None) -> None:
        """Begins a tick: watchdog and lease.

        Args:
            now_s: the robot's time, never going back [s].
            tick: the tick; from then on the age of a command that answers it counts
                by time as well, which ticks of a loop that is late do not tell. The
                delay of the loop is watched only where ticks are told.
        """
        if tick is not None:
            self._began[tick % len(self._began)] = (tick, now_s)
        np.copyto(self._before, self._posture)
        if self._listens():
            self._watch(now_s - self._heard_s)
        if tick is not None and self.mode is RobotMode.ACTIVE:
            self._watch_delay(tick)
        lease = self.authority.lease
        if lease.has_expired(now_s=now_s):
            self.authority.lose(f"{lease.holder} let its lease expire")

    def check(self, command: JointCommand, *, tick: int, now_s: float) -> Verdict:
        """Judges a command; when accepted, the posture follows it.

        Args:
            command: from the bus or from a controller in this process.
            tick: the newest tick that can have been answered.
            now_s: the robot's time [s].

        Returns:
            What became of it; refusals and clippings are counted.
        """
        if not self.authority.holds_lease(command.commander):
            return self.refuse(Refusal.LEASE, self.authority.why_not(command.commander))
        if command.sequence <= self._sequence:
            detail = f"got {command.sequence} after {self._sequence}"
            return self.refuse(Refusal.SEQUENCE, detail)
        self._sequence = command.sequence
        if not self._listens():
            return self.refuse(Refusal.MODE, f"the robot is {self.mode}")
        age = tick - command.tick
        if not 0 <= age <= self._oldest:
            refusal = Refusal.LATE if age > 0 else Refusal.FUTURE
            detail = f"answers tick {command.tick} at tick {tick}"
            return self.refuse(refusal, detail)
        began_tick, began_s = self._began[command.tick % len(self._began)]
        if (
            began_tick == command.tick
            and now_s - began_s > self._max_age_s + ROUNDING_S
        ):
            detail = f"answers sensors {now_s - began_s:.3f} s old"
            return self.refuse(Refusal.LATE, detail)
        verdict = self._check_posture(command.q, now_s)
        if verdict.accepted:
            self.delay.follow(command.tick)
        return verdict

    def refuse(self, refusal: Refusal, detail: str) -> Verdict:
        """Refuses a command, also one that could not even be read."""
        self.refused[refusal] += 1
        self.authority.reason = f"command refused ({refusal}): {detail}"
        return Verdict(accepted=False, refusal=refusal)

    def status(
        self, *, tick: int, stamp_ns: int, now_s: float, deadline_misses: int
    ) -> RobotStatus:
        """What to tell everyone.

        Args:
            tick: the present tick.
            stamp_ns: the robot's monotonic clock [ns].
            now_s: the robot's time [s].
            deadline_misses: ticks that went on without their command.
        """
        authority = self.authority
        return RobotStatus(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=stamp_ns,
            mode=authority.mode,
            fault=authority.fault,
            reason=authority.reason,
            commander=authority.lease.holder,
            command_age_s=now_s - self._heard_s if self._is_commanded else -1.0,
            q_command=self._posture.tolist(),
            refused=dict(self.refused),
            clipped=dict(self.clipped),
            deadline_misses=deadline_misses,
        )

    def _check_posture(self, q: list[float], now_s: float) -> Verdict:
        if len(q) != len(self._names):
            detail = f"got {len(q)} numbers, expected {len(self._names)}"
            return self.refuse(Refusal.SIZE, detail)
        if not math.isfinite(sum(q)):
            return self.refuse(Refusal.NOT_FINITE, "NaN or infinity in q")
        self._wanted[:] = q
        if self._is_first or self.authority.is_silent:
            far = np.abs(self._wanted - self._posture)
            tolerance = self._settings.first_command_tolerance_rad
            if far.max() > tolerance:
                detail = (
                    f"{self._names[int(far.argmax())]} is {far.max():.4f} rad from "
                    f"the held posture, at most {tolerance:g} allowed; start from "
                    "what the robot holds"
                )
                return self.refuse(Refusal.FIRST_COMMAND, detail)
        return self._follow(now_s)

    def _follow(self, now_s: float) -> Verdict:
        clipped = self._limits.clip(self._wanted, self._before, out=self._allowed)
        settings = self._settings
        if clipped and settings.beyond_limits == "refuse" and not settings.warn_only:
            self.clipped.update(clipped)
            return self.refuse(Refusal.LIMIT, f"{self._excess(clipped)}")
        if self.authority.is_silent:
            self.authority.go_on()
        self._is_first = False
        self._is_commanded = True
        self._heard_s = now_s
        self.authority.lease.renew(now_s=now_s)
        follows_all = bool(clipped) and settings.warn_only
        np.copyto(self._posture, self._wanted if follows_all else self._allowed)
        if not clipped:
            return _ACCEPTED
        self.clipped.update(clipped)
        done = "followed beyond its limits" if follows_all else "clipped"
        self.authority.reason = f"command {done}: {self._excess(clipped)}"
        return Verdict(accepted=True, clipped=clipped)

    def _excess(self, limits: tuple[Limit, ...]) -> str:
        """The limits a command ran into, and how far beyond them it is."""
        joint, excess = self._limits.worst_joint()
        return f"{', '.join(limits)}: {self._names[joint]} by {excess:.4f} rad"

    def _listens(self) -> bool:
        return self.mode is RobotMode.ACTIVE or self.authority.is_silent

    def _watch(self, silence_s: float) -> None:
        """Acts on the silence of the commander; it may be busy before its first."""
        settings = self._settings
        if self._is_first:
            if silence_s > settings.fault_after_s:
                self._is_first = False
                self.authority.hold(f"no command in {silence_s:.3f} s after enabling")
        elif silence_s > settings.fault_after_s:
            self.authority.fail(f"no command for {silence_s:.3f} s")
        elif silence_s > settings.hold_after_s and self.mode is RobotMode.ACTIVE:
            self.authority.hold_for_silence(f"no command for {silence_s:.3f} s")

    def _watch_delay(self, tick: int) -> None:
        """Acts on a loop that is too slow, though never silent."""
        self.delay.count(tick)
        limit_s = self._settings.max_loop_delay_s
        if limit_s is not None and self.delay.mean_s > limit_s:
            self.authority.fail(
                f"commands answered sensors over {1e3 * limit_s:g} ms old on average: "
                "the loop is too slow"
            )
