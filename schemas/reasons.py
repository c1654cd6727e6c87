"""Why something ended, changed, was refused or was lost: words to decide by.

What one process tells another is one of these, with a text beside it. The text is for
people; nothing decides by it.
"""

from __future__ import annotations

import signal
from collections.abc import Mapping
from enum import StrEnum

SIGNALS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM)
"""What asks a process to end: Ctrl-C, a kill, and a terminal that closes; not the last
one to a process that was started to outlive it, as by nohup."""
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
    SIGNALS = (*SIGNALS, signal.SIGHUP)
NONE = "-"
"""What a table says in place of a figure."""


class ModeCause(StrEnum):
    """Why a robot's gate is in its mode."""

    STARTED = "started"
    """It has just come up."""
    REQUESTED = "requested"
    """Its commander asked for the mode."""
    RESET = "reset"
    """Its commander reset a fault."""
    HEARD_AGAIN = "heard_again"
    """Its commander was silent for a moment and goes on."""
    SILENCE = "silence"
    """Its commander sends nothing: HOLD at first, then FAULT."""
    NO_FIRST_COMMAND = "no_first_command"
    """It was enabled, and no command followed."""
    LOOP_TOO_SLOW = "loop_too_slow"
    """Commands answered sensors too old to balance with."""
    RELEASED = "released"
    """Its commander gave the lease back."""
    LEASE_EXPIRED = "lease_expired"
    """Its commander let the lease expire."""
    COMMANDER_GONE = "commander_gone"
    """Its commander's process has ended."""
    ESTOP = "estop"
    """Somebody pressed the emergency stop."""
    RUN_OVER = "run_over"
    """The scenario has gone to its end."""
    FELL = "fell"
    """The robot fell, which ends a run."""
    STOPPED = "stopped"
    """Its process was asked to end."""
    NO_COMMANDER = "no_commander"
    """Nobody took command in time."""


class RequestRefusal(StrEnum):
    """Why a request was not done."""

    NONE = "none"
    """It was done."""
    MALFORMED = "malformed"
    """It cannot be read, or is of another schema version."""
    UNKNOWN_ACTION = "unknown_action"
    """No such action."""
    NO_NAME = "no_name"
    """A commander needs a name."""
    LEASE = "lease"
    """Somebody else holds the lease, or nobody does."""
    WRONG_ROBOT = "wrong_robot"
    """It is meant for another robot, by its description or its instance."""
    IN_FAULT = "in_fault"
    """The robot is in FAULT; reset it first."""
    IS_OFF = "is_off"
    """The robot is OFF; ask for hold first."""
    NO_FAULT = "no_fault"
    """There is no fault to reset."""
    PACE = "pace"
    """The two sides have different paces."""
    BAD_VALUE = "bad_value"
    """A setting or a push that cannot be done."""
    NOT_SUPPORTED = "not_supported"
    """This robot or controller has nothing of the kind."""
    RECORDED = "recorded"
    """A record is played; nobody can change it."""
    NO_ANSWER = "no_answer"
    """Nothing that can be read came back."""


class SensorTrouble(StrEnum):
    """Why a sensor is not believed."""

    MISSING = "missing"
    """No message."""
    NOT_A_NUMBER = "not_a_number"
    """A NaN or an infinity."""
    OUT_OF_RANGE = "out_of_range"
    """More than it can report."""
    JUMPED = "jumped"
    """It changed by more than it can in one tick."""
    FROZEN = "frozen"
    """It repeats itself to the last bit while others move."""
    OVERLOADED = "overloaded"
    """A foot's force that would be an impact, if it did not last so long."""
    OFFSET = "offset"
    """A foot's force along the sole that no joint feels; it is taken off."""


class StabilizerState(StrEnum):
    """What a stabilizer is doing."""

    ACTIVE = "active"
    """It balances, and believes everything."""
    DEGRADED = "degraded"
    """It balances; a sensor is silent, or an ankle's force terms are off."""
    UNSOLVED = "unsolved"
    """A QP failed: the posture is kept in this tick."""
    PAUSED = "paused"
    """Somebody asked for a hold: the robot keeps its posture."""
    SOFT_STOP = "soft_stop"
    """Asked to end: it balances on, with less and less motion."""
    FADE_OUT = "fade_out"
    """It gives up: the last motion fades out."""
    HELD = "held"
    """The command stands still for good."""


class EndReason(StrEnum):
    """Why a stabilizer ended, or is about to."""

    NONE = "none"
    """It goes on."""
    RUN_OVER = "run_over"
    """The robot's run has gone to its end."""
    FELL = "fell"
    """The robot fell."""
    STOPPED = "stopped"
    """Its process was asked to end."""
    SENSOR_LOST = "sensor_lost"
    """A sensor is lost that it cannot do without."""
    CONTROLLER_FAILED = "controller_failed"
    """Its controller answers with what is no posture."""
    ROBOT_FAULT = "robot_fault"
    """The robot is in FAULT."""
    LEASE_LOST = "lease_lost"
    """It is not the robot's commander any more."""
    ROBOT_ENDED = "robot_ended"
    """The robot ended before its run was over."""
    ROBOT_GONE = "robot_gone"
    """The robot's process is not there any more."""
    ROBOT_SILENT = "robot_silent"
    """The robot is there, but sends no sensors."""


class FallCriterion(StrEnum):
    """How a simulator knows that its robot fell."""

    TILT = "tilt"
    """The base leans too far to come back."""
    HEIGHT = "height"
    """The base is too low over the soles."""
    TOUCH = "touch"
    """A link above the ankles is down at the soles."""
    NOT_FINITE = "not_finite"
    """The state is not a number: the simulation blew up."""


class Outcome(StrEnum):
    """How a run went."""

    STOOD = "stood"
    """It balanced to the end."""
    WALKED = "walked"
    """It walked as planned and balanced to the end."""
    FELL = "fell"
    """It fell."""
    HELD = "held"
    """It did not fall, but at the end it only kept its posture."""
    FAULT = "fault"
    """It did not fall, but its gate ended in FAULT."""
    NOT_CONTROLLED = "not_controlled"
    """It did not fall, but nobody controlled it."""
    INTERRUPTED = "interrupted"
    """It was ended before its time."""

    @property
    def is_up(self) -> bool:
        """Whether the run counts as a success."""
        return self in (Outcome.STOOD, Outcome.WALKED)


def counted(counts: Mapping[str, int]) -> str:
    """How often each of some reasons was given; ``none`` for none at all."""
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"


def given(value: float | None, form: str = "") -> str:
    """A figure as text; a dash for none."""
    return NONE if value is None else format(value, form)


def plain(reason: StrEnum) -> str:
    """A reason as people write it: ``run over``."""
    return reason.replace("_", " ")


def in_words(reason: StrEnum, detail: str) -> str:
    """A reason and its detail on one line: ``sensor lost: imu missing``."""
    return f"{plain(reason)}: {detail}" if detail else plain(reason)
