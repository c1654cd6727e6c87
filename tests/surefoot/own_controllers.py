"""Controllers as a user writes them, outside the packages."""

from __future__ import annotations

from typing import Any

import numpy as np

from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.controller import ControllerOutput
from surefoot.stabilizer.whole_body.controller import WholeBodyController


class Derived(WholeBodyController):
    """Changes nothing of a shipped one."""


class Stay:
    """Keeps the posture it began with; answers by a bare array."""

    def start(self, snapshot: Any, q_command: np.ndarray) -> None:
        self.q = q_command.copy()

    def step(self, snapshot: Any, reference: Any = None) -> np.ndarray:
        return self.q


class StayWithRobot(Stay):
    """Takes the robot, leaves out the reference, and has a name of its own."""

    name = "stay"

    def __init__(self, robot: Any) -> None:
        self.n_a = robot.n_a

    def step(self, snapshot: Any) -> list[float]:
        assert self.n_a == len(snapshot.q)
        return self.q.tolist()


class StayWithSettings(Stay):
    """Takes robot and settings."""

    def __init__(self, robot: Any, settings: Any) -> None:
        self.gain = settings.tsid.base_kp


class TooShort(Stay):
    """Answers with a joint too few."""

    def step(self, snapshot: Any, reference: Any = None) -> np.ndarray:
        return self.q[:-1]


class Fails(Stay):
    """Answers NaN after 0.1 s of motion, in the array that it always uses."""

    ticks = 100

    def step(self, snapshot: Any, reference: Any = None) -> np.ndarray:
        self.ticks -= 1
        self.q += 1e-5 if self.ticks > 0 else np.nan
        return self.q


class Raises(Stay):
    """Raises an exception after 0.1 s of motion."""

    ticks = 100

    def step(self, snapshot: Any, reference: Any = None) -> np.ndarray:
        self.ticks -= 1
        self.q += 1e-5
        if self.ticks == 0:
            raise ValueError("boom")
        return self.q


class RaisesAtStart(Stay):
    """Raises an exception before its first answer."""

    def start(self, snapshot: Any, q_command: np.ndarray) -> None:
        raise LookupError("no such\ngain")


class Exits(Stay):
    """Leaves as a script does."""

    def step(self, snapshot: Any, reference: Any = None) -> np.ndarray:
        raise SystemExit(3)


class Tells(Stay):
    """Answers with a whole output, in the forms that are at hand."""

    wrong: Any = None

    def step(self, snapshot: Any, reference: Any = None) -> ControllerOutput:
        answer: Any = ControllerOutput(self.q)
        answer.q_command = self.q.tolist()
        answer.F_id, answer.com = [0.0] * 12, (0.0, 0.0, 0.8)
        answer.in_contact = np.array([True, False])
        if self.wrong is not None:
            answer.F_meas = self.wrong
        return answer


class TellsTooLittle(Tells):
    """Answers with the wrench of one foot."""

    wrong = np.zeros(6)


class ByKeyword(Stay):
    """Takes the reference by keyword only."""

    heard: Any = None

    def step(self, snapshot: Any, *, reference: Any = None) -> np.ndarray:
        self.heard = reference
        return self.q


class OfItsOwn(Stay):
    """Has a parameter of its own."""

    def __init__(self, robot: Any, gain: float = 3.0) -> None:
        self.gain = gain


def with_name(robot: Any) -> WholeBodyController:
    """Return a shipped controller, as one that gets another task or solver."""
    return WholeBodyController(robot, ControllerSettings())


class NoStep:
    """No controller, since it lacks a step."""

    def start(self, snapshot: Any, q_command: np.ndarray) -> None:
        """Do nothing."""


not_a_class = 3
