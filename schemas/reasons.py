"""Reasons why something ended, changed, was refused or was lost, as enums.

A process tells another one of these reasons and a text beside it. Decisions are made by
the reason alone; the text is for people.
"""

from __future__ import annotations

import signal
from collections.abc import Mapping
from enum import StrEnum

SIGNALS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask a process to end: Ctrl-C, a kill, and a terminal that closes. The
last is left out of a process that was started to outlive its terminal (nohup)."""
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
    SIGNALS = (*SIGNALS, signal.SIGHUP)
NONE = "-"
"""Text in tables where there is no figure."""


class ModeCause(StrEnum):
    """Why a robot's gate is in its mode."""

    STARTED = "started"
    """The gate has just started."""
    REQUESTED = "requested"
    """Its commander asked for the mode."""
    RESET = "reset"
    """Its commander reset a fault."""
    HEARD_AGAIN = "heard_again"
    """The commander goes on after a short silence."""
    SILENCE = "silence"
    """The commander is silent: the gate goes to HOLD, then to FAULT."""
    NO_FIRST_COMMAND = "no_first_command"
    """The robot was enabled, and no command followed."""
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
    """The scenario has ended."""
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
    """The request cannot be read, or is of another schema version."""
    UNKNOWN_ACTION = "unknown_action"
    """No such action."""
    NO_NAME = "no_name"
    """A commander needs a name."""
    LEASE = "lease"
    """Somebody else holds the lease, or nobody does."""
    WRONG_ROBOT = "wrong_robot"
    """The request is for another robot: its description or its instance differs."""
    IN_FAULT = "in_fault"
    """The robot is in FAULT; reset it first."""
    IS_OFF = "is_off"
    """The robot is OFF; ask for hold first."""
    NO_FAULT = "no_fault"
    """There is no fault to reset."""
    PACE = "pace"
    """One side runs in lockstep, the other in real time."""
    BAD_VALUE = "bad_value"
    """The setting or the push cannot be applied."""
    NOT_SUPPORTED = "not_supported"
    """This robot or controller does not offer such a request."""
    RECORDED = "recorded"
    """A record is being played, which cannot be changed."""
    NO_ANSWER = "no_answer"
    """No readable answer came back."""


class SensorTrouble(StrEnum):
    """Why a sensor is not trusted."""

    MISSING = "missing"
    """No message came."""
    NOT_A_NUMBER = "not_a_number"
    """A reading is NaN or infinite."""
    OUT_OF_RANGE = "out_of_range"
    """A reading is beyond the sensor's range."""
    JUMPED = "jumped"
    """A reading changed by more than is possible in one tick."""
    FROZEN = "frozen"
    """Readings repeat to the last bit while others move."""
    OVERLOADED = "overloaded"
    """A foot's force is as large as an impact, but lasts longer than one."""
    INCONSISTENT = "inconsistent"
    """The IMU's gyroscope and its own attitude tell different motions, or a foot's
    wrench suddenly presses outside of its sole."""
    OFFSET = "offset"
    """A foot's force along the sole is felt by no joint, and is subtracted; or the
    gyroscope's bias has changed since the start, and is learnt anew."""


class StabilizerState(StrEnum):
    """What a stabilizer is doing."""

    ACTIVE = "active"
    """It balances, and trusts all sensors."""
    DEGRADED = "degraded"
    """It balances; a sensor is silent, or an ankle's force terms are off."""
    UNSOLVED = "unsolved"
    """A QP failed: the posture is kept for this tick."""
    PAUSED = "paused"
    """Somebody asked for a hold: the robot keeps its posture."""
    SOFT_STOP = "soft_stop"
    """It was asked to end: it balances on with less and less motion."""
    FADE_OUT = "fade_out"
    """It gives up: the last motion fades out."""
    HELD = "held"
    """The command stands still for good."""


class EndReason(StrEnum):
    """Why a stabilizer ended, or is about to."""

    NONE = "none"
    """It goes on."""
    RUN_OVER = "run_over"
    """The robot's run has ended."""
    FELL = "fell"
    """The robot fell."""
    STOPPED = "stopped"
    """Its process was asked to end."""
    SENSOR_LOST = "sensor_lost"
    """A sensor is lost without which it cannot go on."""
    CONTROLLER_FAILED = "controller_failed"
    """Its controller's answers are not valid postures."""
    ROBOT_FAULT = "robot_fault"
    """The robot is in FAULT."""
    LEASE_LOST = "lease_lost"
    """It is no longer the robot's commander."""
    ROBOT_ENDED = "robot_ended"
    """The robot ended before its run was over."""
    ROBOT_GONE = "robot_gone"
    """The robot's process is gone."""
    ROBOT_SILENT = "robot_silent"
    """The robot is there, but sends no sensors."""


class FallCriterion(StrEnum):
    """Criteria by which the simulator decides that its robot fell."""

    TILT = "tilt"
    """The base leans too far to come back."""
    HEIGHT = "height"
    """The base is too low over the soles."""
    TOUCH = "touch"
    """A link above the ankles is as low as the soles."""
    NOT_FINITE = "not_finite"
    """The state is not finite: the simulation diverged."""


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
    """Return how often each reason was given, as text; ``none`` for no reasons."""
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "none"


def given(value: float | None, form: str = "") -> str:
    """Return a figure as text; a dash for None."""
    return NONE if value is None else format(value, form)


def plain(reason: StrEnum) -> str:
    """Return a reason as plain words: ``run over``."""
    return reason.replace("_", " ")


def in_words(reason: StrEnum, detail: str) -> str:
    """Return a reason and its detail on one line: ``sensor lost: imu missing``."""
    return f"{plain(reason)}: {detail}" if detail else plain(reason)
