"""Who may command the robot, and in which mode it is."""

from __future__ import annotations

from robot_io.lease import Lease
from robot_io.verdict import Answer
from schemas.messages import RobotMode

_DONE = Answer(accepted=True)


class Authority:
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
        fault: why it is in FAULT; empty otherwise.
        reason: why something was last refused, changed or stopped.
        lease: who commands.
        is_silent: in HOLD only because the commander fell silent.
    """

    def __init__(self, *, lease_s: float) -> None:
        """Starts in HOLD with a free lease.

        Args:
            lease_s: a commander silent for longer loses the lease [s].
        """
        self.mode = RobotMode.HOLD
        self.fault = ""
        self.reason = ""
        self.is_silent = False
        self.lease = Lease(duration_s=lease_s)

    def request(self, action: str, who: str, *, now_s: float) -> Answer:
        """Does what is asked, or says why not.

        Args:
            action: take, release, enable, hold, disable or reset.
            who: identity of who asks.
            now_s: the robot's time [s].
        """
        if action == "take":
            return self._take(who, now_s)
        if not self.holds_lease(who):
            return self._decline(self.why_not(who))
        self.lease.renew(now_s=now_s)
        match action:
            case "release":
                self.lose(f"released by {who}")
                return _DONE
            case "reset":
                return self._reset(who)
            case "enable" | "hold" | "disable":
                return self._change(action, who)
        return self._decline(
            f"got action {action!r}, expected take, release, enable, hold, disable "
            "or reset"
        )

    def holds_lease(self, who: str) -> bool:
        """Whether it is this one who commands."""
        return bool(who) and who == self.lease.holder

    def why_not(self, who: str) -> str:
        """Why someone may not command: whose turn it is instead."""
        if self.lease.holder:
            return f"{self.lease.holder} holds the lease, {who or 'no name'} does not"
        return "nobody holds the lease; take it first"

    def stop(self, source: str) -> Answer:
        """E-stop: FAULT until reset."""
        self.fail(f"e-stop by {source or 'someone without a name'}")
        return _DONE

    def fail(self, fault: str) -> None:
        """To FAULT; the first fault stays the one that is told."""
        if self.mode is not RobotMode.FAULT:
            self.fault = fault
        self._set(RobotMode.FAULT, fault)

    def hold(self, reason: str) -> None:
        """From ACTIVE to HOLD."""
        is_active = self.mode is RobotMode.ACTIVE
        self._set(RobotMode.HOLD if is_active else self.mode, reason)

    def hold_for_silence(self, reason: str) -> None:
        """From ACTIVE to HOLD, from where the same commander may go on."""
        self.hold(reason)
        self.is_silent = True

    def go_on(self) -> None:
        """Back to ACTIVE: the commander is heard again."""
        self._set(RobotMode.ACTIVE, self.reason)

    def lose(self, reason: str) -> None:
        """The lease is free again; what moved, holds."""
        self.lease.release()
        self.hold(reason)

    def finish(self, reason: str) -> None:
        """To OFF, also from HOLD, the lease free; a fault is kept."""
        self.lose(reason)
        if self.mode is not RobotMode.FAULT:
            self._set(RobotMode.OFF, reason)

    def _take(self, who: str, now_s: float) -> Answer:
        if not who:
            return self._decline("a commander needs a name")
        if not self.lease.take(who, now_s=now_s):
            return self._decline(self.why_not(who))
        return _DONE

    def _change(self, action: str, who: str) -> Answer:
        if self.mode is RobotMode.FAULT:
            return self._decline(f"in fault ({self.fault}); reset it first")
        if action == "enable":
            if self.mode is RobotMode.OFF:
                return self._decline("off; ask for hold first")
            self._set(RobotMode.ACTIVE, "")
        else:
            mode = RobotMode.HOLD if action == "hold" else RobotMode.OFF
            self._set(mode, f"{action} asked for by {who}")
        return _DONE

    def _reset(self, who: str) -> Answer:
        if self.mode is not RobotMode.FAULT:
            return self._decline(f"no fault to reset, the robot is {self.mode}")
        self.fault = ""
        self._set(RobotMode.HOLD, f"reset by {who}")
        return _DONE

    def _set(self, mode: RobotMode, reason: str) -> None:
        self.mode = mode
        self.reason = reason
        self.is_silent = False

    def _decline(self, why: str) -> Answer:
        self.reason = f"request refused: {why}"
        return Answer(accepted=False, reason=why)
