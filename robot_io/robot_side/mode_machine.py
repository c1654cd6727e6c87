"""Who may command the robot, and in which mode it is."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import ModeCause, RequestRefusal


class Refusal(StrEnum):
    """Why a command never reached the servos; the keys of ``refused`` on status."""

    MALFORMED = "malformed"
    """Not a joint command: bytes, fields, types."""
    SCHEMA = "schema"
    """Written for another schema version."""
    LEASE = "lease"
    """From someone who does not hold the lease."""
    MODE = "mode"
    """The robot is not ACTIVE."""
    SEQUENCE = "sequence"
    """Repeated or out of order."""
    LATE = "late"
    """Answers sensors too long ago, by ticks or by the robot's clock."""
    FUTURE = "future"
    """Answers a tick that has not been."""
    SIZE = "size"
    """Not one number per joint."""
    NOT_FINITE = "not_finite"
    """A NaN or an infinity."""
    LIMIT = "limit"
    """Beyond a limit, where the robot file says to refuse and not to clip."""
    FIRST_COMMAND = "first_command"
    """The first one after enabling is far from the held posture."""


class Limit(StrEnum):
    """What a command ran into; the keys of ``clipped`` on status."""

    POSITION = "position"
    VELOCITY = "velocity"
    STEP = "step"


class CommandResult(NamedTuple):
    """Outcome of one command.

    Attributes:
        answers: the tick it answers.
        posture: (n_a,) what the servos are to follow now [rad], not to be written:
            the command, clipped or as it is; the posture before it when refused.
        refusal: why it is refused; None when it is accepted.
        clipped: limits it ran into.
    """

    answers: int
    posture: Array
    refusal: Refusal | None = None
    clipped: tuple[Limit, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether the servos follow it, clipped or as it is."""
        return self.refusal is None


class Answer(NamedTuple):
    """Outcome of a request.

    Attributes:
        refusal: why it was not done; ``none`` when it was.
        detail: the same in words; empty when it was done.
    """

    refusal: RequestRefusal = RequestRefusal.NONE
    detail: str = ""

    @property
    def accepted(self) -> bool:
        """Whether it was done."""
        return self.refusal is RequestRefusal.NONE


DONE = Answer()


class Lease:
    """Command of the robot, held by one commander, lost by silence.

    Attributes:
        holder: identity of the commander; empty when nobody holds it.
    """

    def __init__(self, *, duration_s: float) -> None:
        """Start free.

        Args:
            duration_s: a holder silent for longer loses it [s].
        """
        self.holder = ""
        self._duration_s = duration_s
        self._renewed_s = 0.0

    def take(self, who: str, *, now_s: float) -> bool:
        """Take or renews it; False when someone else holds it."""
        if self.holder not in ("", who):
            return False
        self.holder = who
        self._renewed_s = now_s
        return True

    def renew(self, *, now_s: float) -> None:
        """Renew the lease: the commander was heard."""
        self._renewed_s = now_s

    def release(self) -> None:
        """Free it."""
        self.holder = ""

    def has_expired(self, *, now_s: float) -> bool:
        """Return whether the commander has been silent for too long."""
        return bool(self.holder) and now_s - self._renewed_s > self._duration_s


class ModeMachine:
    """Modes and lease of a robot; every change is asked for by name.

    ====== ================================ =============================
    mode   the servos                       left by
    ====== ================================ =============================
    OFF    follow nobody                    hold
    HOLD   keep the last posture            enable, disable
    ACTIVE follow the holder of the lease   hold, disable, loss, silence
    FAULT  keep the last posture            reset
    ====== ================================ =============================

    Losing the lease, in whatever way, leads from ACTIVE to HOLD. Only its holder may
    ask for a mode; an e-stop is open to everyone.

    Attributes:
        mode: present mode.
        cause: why it is in this mode; in FAULT the first fault.
        detail: the same in words.
        notice: what was last refused or cut to a limit, in words.
        lease: who commands.
        is_silent: in HOLD only because the commander fell silent.
    """

    def __init__(self, *, lease_s: float) -> None:
        """Start in HOLD with a free lease.

        Args:
            lease_s: a commander silent for longer loses the lease [s].
        """
        self.mode = RobotMode.HOLD
        self.cause, self.detail = ModeCause.STARTED, ""
        self.notice = ""
        self.is_silent = False
        self.lease = Lease(duration_s=lease_s)

    def request(self, action: str, who: str, *, now_s: float) -> Answer:
        """Do what is asked, or say why not.

        Args:
            action: take, release, enable, hold, disable or reset.
            who: identity of who asks.
            now_s: the robot's time [s].
        """
        if action == "take":
            return self._take(who, now_s)
        if not self.holds_lease(who):
            return self.decline(RequestRefusal.LEASE, self.why_not(who))
        self.lease.renew(now_s=now_s)
        match action:
            case "release":
                self.lose(ModeCause.RELEASED, f"released by {who}")
                return DONE
            case "reset" if self.mode is RobotMode.FAULT:
                self._set(RobotMode.HOLD, ModeCause.RESET, f"reset by {who}")
                return DONE
            case "reset":
                why = f"no fault to reset, the robot is {self.mode}"
                return self.decline(RequestRefusal.NO_FAULT, why)
            case "enable" | "hold" | "disable":
                return self._change(action, who)
        return self.decline(
            RequestRefusal.UNKNOWN_ACTION,
            f"got action {action!r}, expected take, release, enable, hold, disable "
            "or reset",
        )

    def holds_lease(self, who: str) -> bool:
        """Return whether this identity is the commander."""
        return bool(who) and who == self.lease.holder

    def why_not(self, who: str) -> str:
        """Return why an identity may not command: who does instead."""
        if self.lease.holder:
            return f"{self.lease.holder} holds the lease, {who or 'no name'} does not"
        return "nobody holds the lease; take it first"

    def decline(self, refusal: RequestRefusal, detail: str) -> Answer:
        """Refuse a request; status tells why."""
        self.notice = f"request refused: {detail}"
        return Answer(refusal, detail)

    def stop(self, source: str) -> Answer:
        """E-stop: FAULT until reset."""
        who = source or "someone without a name"
        self.fail(ModeCause.ESTOP, f"e-stop by {who}")
        return DONE

    def fail(self, cause: ModeCause, detail: str) -> None:
        """Enter FAULT; keep the first cause."""
        if self.mode is not RobotMode.FAULT:
            self._set(RobotMode.FAULT, cause, detail)

    def hold(self, cause: ModeCause, detail: str) -> None:
        """Go from ACTIVE to HOLD; a robot that holds already has one more cause."""
        if self.mode in (RobotMode.ACTIVE, RobotMode.HOLD):
            self._set(RobotMode.HOLD, cause, detail)

    def hold_for_silence(self, detail: str) -> None:
        """Go from ACTIVE to HOLD, from where the same commander may go on."""
        self.hold(ModeCause.SILENCE, detail)
        self.is_silent = True

    def go_on(self) -> None:
        """Go back to ACTIVE: the commander is heard again."""
        self._set(RobotMode.ACTIVE, ModeCause.HEARD_AGAIN, self.detail)

    def lose(self, cause: ModeCause, detail: str) -> None:
        """Free the lease; what moved, holds."""
        self.lease.release()
        self.hold(cause, detail)

    def finish(self, cause: ModeCause, detail: str) -> None:
        """Go to OFF, also from HOLD, the lease free; a fault is kept."""
        self.lease.release()
        if self.mode is not RobotMode.FAULT:
            self._set(RobotMode.OFF, cause, detail)

    def _take(self, who: str, now_s: float) -> Answer:
        if not who:
            return self.decline(RequestRefusal.NO_NAME, "a commander needs a name")
        if not self.lease.take(who, now_s=now_s):
            return self.decline(RequestRefusal.LEASE, self.why_not(who))
        return DONE

    def _change(self, action: str, who: str) -> Answer:
        if self.mode is RobotMode.FAULT:
            return self.decline(
                RequestRefusal.IN_FAULT, f"in fault ({self.detail}); reset it first"
            )
        mode = _MODES[action]
        if mode is RobotMode.ACTIVE and self.mode is RobotMode.OFF:
            return self.decline(RequestRefusal.IS_OFF, "off; ask for hold first")
        self._set(mode, ModeCause.REQUESTED, f"{action} asked for by {who}")
        return DONE

    def _set(self, mode: RobotMode, cause: ModeCause, detail: str) -> None:
        self.mode, self.cause, self.detail = mode, cause, detail
        self.is_silent = False


_MODES = {
    "enable": RobotMode.ACTIVE,
    "hold": RobotMode.HOLD,
    "disable": RobotMode.OFF,
}
