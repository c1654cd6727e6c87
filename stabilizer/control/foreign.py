"""A controller from outside, held to the controller protocol."""

from __future__ import annotations

import inspect
from typing import TYPE_CHECKING, Any

import numpy as np

from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.messages import Reference
from surefoot.stabilizer.control.controller import ControllerOutput
from surefoot.stabilizer.errors import ControllerError

if TYPE_CHECKING:
    from surefoot.stabilizer.qp import QpData

OPTIONAL = ("retune", "degrade", "undo_overload")
"""Methods of :class:`Tunable` and :class:`Degradable`, used where they are there."""


class ForeignController:
    """Wraps any object with ``start(snapshot, q_command)`` and ``step(snapshot, ...)``.

    ``step`` may return a bare array of joint positions or a
    :class:`ControllerOutput`; it may leave out the reference.

    Attributes:
        name: as reported on status.
        inner: the object itself.
        failure: always None; a controller from outside keeps its own failures.
    """

    def __init__(self, inner: Any, *, n_a: int, name: str | None = None) -> None:
        """Check that the object has what a controller needs.

        Args:
            inner: the object.
            n_a: number of joints.
            name: for status and results; the object's own when None.

        Raises:
            ControllerError: a method is missing.
        """
        kind = type(inner).__name__
        missing = [m for m in ("start", "step") if not callable(getattr(inner, m, 0))]
        if missing:
            raise ControllerError(
                f"controller {name or kind}: {kind} has no {' and no '.join(missing)}; "
                "expected start(snapshot, q_command) and step(snapshot, reference)"
            )
        self.inner = inner
        self.name = name or str(getattr(inner, "name", kind))
        self.failure: QpData | None = None
        self._n_a = n_a
        self._takes_reference = _takes_two(inner.step)
        self._output = ControllerOutput(np.zeros(n_a))
        for method in OPTIONAL:
            if callable(getattr(inner, method, None)):
                setattr(self, method, getattr(inner, method))

    def start(self, snapshot: Snapshot, q_command: np.ndarray) -> None:
        """Begin on a robot that stands still; see :meth:`Controller.start`."""
        self.inner.start(snapshot, q_command)

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick.

        Raises:
            ControllerError: the answer is not one number per joint.
        """
        answer = (
            self.inner.step(snapshot, reference)
            if self._takes_reference
            else self.inner.step(snapshot)
        )
        if isinstance(answer, ControllerOutput):
            self._check(answer.q_command)
            return answer
        try:
            q_command = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            q_command = np.zeros(0)
        self._check(q_command, answer)
        self._output.q_command = q_command
        return self._output

    def _check(self, q_command: np.ndarray, answer: object = None) -> None:
        if q_command.shape != (self._n_a,):
            got = f"shape {q_command.shape}" if q_command.size else repr(answer)[:60]
            raise ControllerError(
                f"controller {self.name}: step returned {got}, expected "
                f"({self._n_a},): one position per joint of the robot file [rad]"
            )


def _takes_two(step: Any) -> bool:
    """Whether a method can be called with snapshot and reference."""
    try:
        inspect.signature(step).bind(None, None)
    except TypeError:
        return False
    except ValueError:
        return True
    return True
