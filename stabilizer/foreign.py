"""Controllers of users: found by name, made, adapted to the protocol, and blamed."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.errors import SchemaError
from surefoot.schemas.messages import Reference
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.validation import nearest
from surefoot.stabilizer.controller import (
    CONTROLLERS,
    Controller,
    ControllerError,
    ControllerOutput,
    Degradable,
    Doubts,
    PassesOver,
    Tunable,
    UndoesOverload,
    Walks,
)
from surefoot.stabilizer.qp import QpData

ControllerMaker = Callable[[Robot, ControllerSettings], Controller]
"""Makes a new controller, ready to be started once."""


ENTRY_POINTS = "surefoot.controllers"
"""Entry-point group in which other packages offer controllers by name."""
_PROTOCOLS = (PassesOver, Tunable, Walks, Degradable, UndoesOverload, Doubts)
OPTIONAL = tuple(
    name for kind in _PROTOCOLS for name in vars(kind) if not name.startswith("_")
)
"""Methods that a controller may have, used if present."""
_CALLERS = ("<", str(Path(__file__).parents[1]), str(Path(importlib.__file__).parent))
"""Beginnings of files that call a user's code: frozen, the library's, importlib's."""
_LONGEST_TEXT = 200
_TEXTS: dict[str, bytes] = {}
"""Sources of the modules that were loaded here from files, by name."""
_SIZES = {
    "F_id": 12, "F_meas": 12, "com": 3, "com_reference": 3, "base_pose": 7,
    "base_twist": 6, "r": 12,
}  # fmt: skip
"""Lengths of the optional arrays of a :class:`ControllerOutput`, but ``v_joint``."""


def told_of(error: BaseException) -> str:
    """Return an exception of a user's code on one line: class, message and place.

    The place is the deepest line of the file in which the user's code began.
    """
    if isinstance(error, ControllerError):
        return str(error)
    if isinstance(error, SyntaxError):
        file = Path(error.filename or "").name
        return f"{file}, line {error.lineno}: {error.msg}"
    message = " ".join(str(error).split())[:_LONGEST_TEXT]
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    frames = traceback.extract_tb(error.__traceback__)
    files = [frame.filename for frame in frames]
    begun = next((f for f in files if not f.startswith(_CALLERS)), files[-1])
    lines = [frame.lineno for frame in frames if frame.filename == begun]
    return f"{text} ({Path(begun).name}, line {lines[-1]})"


def list_controllers() -> list[str]:
    """Return the names of all controllers: shipped ones and installed entry points."""
    installed = {entry.name for entry in entry_points(group=ENTRY_POINTS)}
    return [*CONTROLLERS, *sorted(installed - set(CONTROLLERS))]


def find_target(name: str) -> Any:
    """Find the class, or another maker, of a foreign controller.

    Raises:
        ControllerError: there is no such controller, or its module does not load.
        ImportError: a package that it imports is missing.
    """
    if not isinstance(name, str):
        raise ControllerError(
            f"controller: got {name!r}, expected a name such as 'whole-body', or "
            "'path/to/file.py:Class'"
        )
    place, colon, attribute = name.rpartition(":")
    if colon:
        with _blamed(name):
            module = _module(place)
        target = getattr(module, attribute, None)
        if target is None:
            offered = [n for n, value in vars(module).items() if inspect.isclass(value)]
            raise ControllerError(
                f"controller {name!r}: {place} has no {attribute!r}"
                f"{nearest(attribute, offered)}"
            )
        return target
    for entry in entry_points(group=ENTRY_POINTS):
        if entry.name == name:
            with _blamed(name):
                return entry.load()
    known = list_controllers()
    raise ControllerError(
        f"controller: got {name!r}{nearest(name, known)}; expected one of "
        f"{', '.join(known)}, package.module:Class or path/to/file.py:Class"
    )


def maker_of(name: str, target: Any) -> ControllerMaker:
    """Return a maker from a class or a function of robot and settings.

    Raises:
        ControllerError: it cannot be called.
    """
    if not callable(target):
        raise ControllerError(
            f"controller {name!r}: got {type(target).__name__}, expected a class with "
            "start(snapshot, q_command) and step(snapshot, reference)"
        )
    given = takes(target)

    def make(robot: Robot, settings: ControllerSettings) -> Controller:
        with _blamed(name):
            made = target(*(robot, settings)[:given])
        adapted = adapt(made, robot, name=name)
        adapted.name = name  # a shipped one's, too: it may have another solver or task
        return adapted

    return make


@contextmanager
def _blamed(name: str) -> Iterator[None]:
    """Name the controller, and where it failed, in any error of its own code.

    A missing package stays an ImportError: this machine lacks it.
    """
    try:
        yield
    except (ControllerError, SchemaError):
        raise
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"controller {name}: {told_of(error)}", name=error.name
        ) from error
    except (Exception, SystemExit) as error:
        raise ControllerError(f"controller {name}: {told_of(error)}") from error


def takes(target: Any) -> int:
    """Return how many of robot and settings a maker takes.

    A parameter with a default is one of its own, unless it has their name.
    """
    try:
        parameters = inspect.signature(target).parameters.values()
    except (TypeError, ValueError):  # not callable, or does not tell
        return 2
    kinds = [parameter.kind for parameter in parameters]
    if inspect.Parameter.VAR_POSITIONAL in kinds:
        return 2
    last = inspect.Parameter.POSITIONAL_OR_KEYWORD  # after those without a keyword
    count = 0
    for name, parameter in zip(("robot", "settings"), parameters, strict=False):
        is_own = parameter.default is not parameter.empty and parameter.name != name
        if parameter.kind > last or is_own:
            break
        count += 1
    return count


def _module(place: str) -> ModuleType:
    if place.endswith(".py"):
        return _module_of_file(Path(place))
    try:
        return importlib.import_module(place)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if place != missing and not place.startswith(f"{missing}."):
            raise  # found, but something it imports is missing
        raise ControllerError(
            f"controller: no module {place!r}; name a module that Python finds, or a "
            "file: path/to/file.py:Class"
        ) from error


def _module_of_file(path: Path) -> ModuleType:
    """Return the module of a file, loaded once per process and findable for pickle.

    A module that is imported already is reused: loaded twice it would have two classes.
    One that was loaded here is loaded anew after a change of its file, as in a
    notebook.
    """
    if not path.is_file():
        raise ControllerError(
            f"controller: {path}: no such file; expected path/to/file.py:Class"
        )
    whole = path.resolve()
    text = whole.read_bytes()
    for name, module in list(sys.modules.items()):
        file = str(vars(module).get("__file__"))
        is_it = file.endswith(whole.name) and Path(file).resolve() == whole
        if is_it and name != "__main__" and _TEXTS.get(name, text) == text:
            return module
    digest = hashlib.sha256(str(whole).encode()).hexdigest()[:8]
    name = f"surefoot_controller_{whole.stem}_{digest}"
    spec = importlib.util.spec_from_file_location(name, whole)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        # Not by its loader, which takes a quick change of the same length for none.
        exec(compile(text, whole, "exec"), vars(module))
    except BaseException:
        del sys.modules[name]
        raise
    _TEXTS[name] = text
    return module


def adapt(controller: Any, robot: Robot, *, name: str | None = None) -> Controller:
    """Adapt an object with ``start`` and ``step`` to the controller protocol.

    A shipped controller is returned unchanged.

    Raises:
        ControllerError: the object has no ``start`` or ``step``.
    """
    is_ours = type(controller).__module__.startswith("surefoot.stabilizer.")
    if isinstance(controller, ForeignController) or is_ours:
        ours: Controller = controller
        return ours
    return ForeignController(controller, n_a=robot.n_a, name=name)


class ForeignController:
    """Wraps any object with ``start(snapshot, q_command)`` and ``step(snapshot, ...)``.

    ``step`` may return a bare array of joint positions or a :class:`ControllerOutput`.
    It may have no parameter for the reference.

    Attributes:
        name: as reported on status.
        inner: the object itself.
    """

    def __init__(self, inner: Any, *, n_a: int, name: str | None = None) -> None:
        """Check that the object has what a controller needs.

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
        self._n_a = n_a
        self._sizes = {"q_command": n_a, "v_joint": n_a, **_SIZES}
        self._step = _with_reference(inner.step)
        self._output = ControllerOutput(np.zeros(n_a))
        for method in OPTIONAL:
            if callable(getattr(inner, method, None)):
                setattr(self, method, getattr(inner, method))

    @property
    def failure(self) -> QpData | None:
        """The first QP that could not be solved, if the object keeps it."""
        kept = getattr(self.inner, "failure", None)
        return kept if isinstance(kept, QpData) else None

    def start(self, snapshot: Snapshot, q_command: np.ndarray) -> None:
        """Begin on a robot that stands still; see :meth:`Controller.start`."""
        self.inner.start(snapshot, q_command)

    def step(
        self, snapshot: Snapshot, reference: Reference | None = None
    ) -> ControllerOutput:
        """Answer one tick.

        Raises:
            ControllerError: the answer is not one number per joint, or another field
                has not the form that :class:`ControllerOutput` states.
        """
        try:
            answer = self._step(snapshot, reference)
        except SystemExit as error:
            raise ControllerError(
                f"controller {self.name}: {told_of(error)}"
            ) from error
        if not isinstance(answer, ControllerOutput):
            q_command, answer = answer, self._output
            answer.q_command = q_command
        for field, size in self._sizes.items():
            value = getattr(answer, field)
            if value is not None or field == "q_command":
                setattr(answer, field, self._numbers(field, value, size))
        if answer.in_contact is not None:
            left, right = self._numbers("in_contact", answer.in_contact, 2).tolist()
            answer.in_contact = (bool(left), bool(right))
        return answer

    def _numbers(self, field: str, value: Any, size: int) -> np.ndarray:
        """Return a field of the answer as an array; it may be a list or a tuple."""
        try:
            numbers = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            numbers = np.zeros(0)
        if numbers.shape == (size,):
            return numbers
        got = f"shape {numbers.shape}" if numbers.size else repr(value)[:60]
        if field == "q_command":
            raise ControllerError(
                f"controller {self.name}: step returned {got}, expected ({size},): one "
                "position per joint of the robot file [rad]"
            )
        raise ControllerError(
            f"controller {self.name}: step returned {field} of {got}, expected "
            f"({size},); see ControllerOutput"
        )


def _with_reference(step: Callable[..., Any]) -> Callable[..., Any]:
    """Return a step as a function of snapshot and reference, however it takes them."""
    try:
        signature = inspect.signature(step)
    except ValueError:  # it does not tell
        return step
    try:
        signature.bind(None, None)
    except TypeError:
        if "reference" in signature.parameters:
            return lambda snapshot, reference: step(snapshot, reference=reference)
        return lambda snapshot, _: step(snapshot)
    return step
