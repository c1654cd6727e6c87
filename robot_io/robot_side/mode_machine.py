"""The robot's mode and lease: who may command it, and what changes its mode."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from surefoot.schemas.arrays import Array
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import ModeCause, RequestRefusal


class Refusal(StrEnum):
    """Reasons to refuse a command; the keys of ``refused`` on status."""

    MALFORMED = "malformed"
    """Not a joint command: bytes, fields, types."""
    SCHEMA = "schema"
    """Written for another schema version."""
    LEASE = "lease"
    """From a sender that does not hold the lease."""
    MODE = "mode"
    """The robot is not ACTIVE."""
    SEQUENCE = "sequence"
    """Repeated or out of order."""
    LATE = "late"
    """Answers sensors that are too old, by ticks or by the robot's clock."""
    FUTURE = "future"
    """Answers a tick that has not yet been."""
    SIZE = "size"
    """Not one number per joint."""
    NOT_FINITE = "not_finite"
    """A NaN or an infinity."""
    LIMIT = "limit"
    """Beyond a limit, and the robot file says to refuse and not to clip."""
    FIRST_COMMAND = "first_command"
    """Far from the held posture, as the first after enabling or after a silence."""


class Limit(StrEnum):
    """Limits that a command can exceed; the keys of ``clipped`` on status."""

    POSITION = "position"
    VELOCITY = "velocity"
    STEP = "step"


class CommandResult(NamedTuple):
    """Outcome of one command.

    Attributes:
        answers: tick that the command answers.
        posture: (n_a,) posture that the servos are to follow now, read-only [rad]: the
            command, clipped or unchanged; the posture before it when refused.
        refusal: reason of the refusal; None when the command is accepted.
    """

    answers: int
    posture: Array
    refusal: Refusal | None = None

    @property
    def accepted(self) -> bool:
        """Whether the servos follow the command, clipped or unchanged."""
        return self.refusal is None


class Answer(NamedTuple):
    """Outcome of a request.

    Attributes:
        refusal: reason of the refusal; ``none`` when the request was carried out.
        detail: the same in words; empty when it was carried out.
    """

    refusal: RequestRefusal = RequestRefusal.NONE
    detail: str = ""

    @property
    def accepted(self) -> bool:
        """Whether the request was carried out."""
        return self.refusal is RequestRefusal.NONE


DONE = Answer()


class Lease:
    """The right to command the robot; one commander holds it, silence loses it.

    Attributes:
        holder: identity of the commander; empty when nobody holds it.
    """

    def __init__(self, *, duration_s: float) -> None:
        """Start free.

        Args:
            duration_s: silence after which a holder loses it [s].
        """
        self.holder = ""
        self._duration_s = duration_s
        self._renewed_s = 0.0

    def take(self, who: str, *, now_s: float) -> bool:
        """Take or renew the lease; return False when someone else holds it."""
        if self.holder not in ("", who):
            return False
        self.holder = who
        self._renewed_s = now_s
        return True

    def renew(self, *, now_s: float) -> None:
        """Renew the lease when the commander was heard."""
        self._renewed_s = now_s

    def release(self) -> None:
        """Free the lease."""
        self.holder = ""

    def has_expired(self, *, now_s: float) -> bool:
        """Return whether the commander has been silent for too long."""
        return bool(self.holder) and now_s - self._renewed_s > self._duration_s


class ModeMachine:
    """Modes and lease of a robot; every change has a named cause.

    ====== ================================ =============================
    mode   the servos                       left by
    ====== ================================ =============================
    OFF    follow nobody                    hold
    HOLD   keep the last posture            enable, disable
    ACTIVE follow the holder of the lease   hold, disable, loss, silence
    FAULT  keep the last posture            reset
    ====== ================================ =============================

    Losing the lease in any way leads from ACTIVE to HOLD. Only its holder may request a
    mode; the e-stop is open to everyone.

    Attributes:
        mode: present mode.
        cause: reason for this mode; in FAULT that of the first fault.
        detail: the same in words.
        notice: the last refusal or clipping, in words.
        lease: the lease, which names the commander.
        is_silent: whether it is in HOLD only because the commander fell silent.
    """

    def __init__(self, *, lease_s: float) -> None:
        """Start in HOLD with a free lease.

        Args:
            lease_s: silence after which a commander loses the lease [s].
        """
        self.mode = RobotMode.HOLD
        self.cause, self.detail = ModeCause.STARTED, ""
        self.notice = ""
        self.is_silent = False
        self.lease = Lease(duration_s=lease_s)

    def request(self, action: str, who: str, *, now_s: float) -> Answer:
        """Carry out a request, or return why not.

        Args:
            action: take, release, enable, hold, disable or reset.
            who: identity of the sender.
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
                why = f"no fault to reset, the robot is in mode {self.mode}"
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
        """Return why an identity may not command, with the present commander."""
        if self.lease.holder:
            return f"{self.lease.holder} holds the lease, {who or 'no name'} does not"
        return "nobody holds the lease; take it first"

    def decline(self, refusal: RequestRefusal, detail: str) -> Answer:
        """Refuse a request; the status will report why."""
        self.notice = f"request refused: {detail}"
        return Answer(refusal, detail)

    def stop(self, source: str) -> Answer:
        """E-stop: enter FAULT until reset."""
        who = source or "someone without a name"
        self.fail(ModeCause.ESTOP, f"e-stop by {who}")
        return DONE

    def fail(self, cause: ModeCause, detail: str) -> None:
        """Enter FAULT; keep the first cause."""
        if self.mode is not RobotMode.FAULT:
            self._set(RobotMode.FAULT, cause, detail)

    def hold(self, cause: ModeCause, detail: str) -> None:
        """Go from ACTIVE to HOLD; in HOLD only change the cause."""
        if self.mode in (RobotMode.ACTIVE, RobotMode.HOLD):
            self._set(RobotMode.HOLD, cause, detail)

    def hold_for_silence(self, detail: str) -> None:
        """Go from ACTIVE to HOLD; the same commander may go on from there."""
        self.hold(ModeCause.SILENCE, detail)
        self.is_silent = True

    def go_on(self) -> None:
        """Go back to ACTIVE when the commander is heard again."""
        self._set(RobotMode.ACTIVE, ModeCause.HEARD_AGAIN, self.detail)

    def lose(self, cause: ModeCause, detail: str) -> None:
        """Free the lease; an ACTIVE robot goes to HOLD."""
        self.lease.release()
        self.hold(cause, detail)

    def finish(self, cause: ModeCause, detail: str) -> None:
        """Free the lease and go to OFF from any mode; a fault is kept."""
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
