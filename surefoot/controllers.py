"""Controllers by name or as objects, and the delay they bear.

Notebooks call the public functions; the command line prints the two notices.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from surefoot.errors import UsageError
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.run_plan import RunPlan, Settings, resolve_robot, resolve_settings
from surefoot.schemas.arrays import MS_PER_S
from surefoot.schemas.motions import Motion
from surefoot.schemas.scenario import Push, SensorFault
from surefoot.schemas.scenario_robot import Delay, Payload, Rod
from surefoot.schemas.settings import ControllerSettings, setting_names
from surefoot.stabilizer import factory
from surefoot.stabilizer.controller import (
    CONTROLLERS,
    BalanceController,
    Controller,
    ControllerError,
    HoldController,
    Walks,
)
from surefoot.stabilizer.foreign import find_target, maker_of, takes

if TYPE_CHECKING:
    from surefoot.stabilizer.margins.margins import LoopMargins

MOST_TICKS = 100
_WALKS = ("whole-body", "zmp")
"""Shipped controllers that take steps, each with the same limits."""
_WHOLE = 1e-6
_LONGER = 1.25
"""Time of a step over the time asked for, above which a walk is called slow [1]."""
_OF_A_TICK = 0.01
"""Largest error of a delay, in ticks; a delay printed with four digits has one."""


def make_controller(
    name: str, robot: str | Path | Robot = "walker", *, settings: Settings = None
) -> Controller:
    """Make a new controller. The run that gets it starts it, once.

    Args:
        name: ``whole-body``, ``zmp``, ``hold``, an installed entry point,
            ``package.module:Class`` or ``path/to/file.py:Class``.
        robot: shipped name, path of a robot file, or a loaded robot.
        settings: ``{"tsid.com_kp": 40.0}``, resolved settings, the name of shipped
            settings, a file, or None for the defaults.

    Raises:
        ControllerError: there is no such controller, or it cannot be made.
        RobotFileError: no such robot.
        FileFormatError: a file or a setting is malformed.
    """
    model = robot if isinstance(robot, Robot) else load_robot(robot)
    return factory.make_controller(name, model, settings_for(name, settings))


def name_of(controller: Any) -> str:
    """Return a controller's name in results.

    A class or an object may define a ``name`` of its own; one that is inherited is
    another controller's.

    Args:
        controller: as for :func:`surefoot.simulate`.

    Raises:
        ControllerError: it is no controller.
    """
    if isinstance(controller, str):
        return controller
    if not callable(controller) and not hasattr(controller, "step"):
        raise ControllerError(
            f"controller: got {controller!r}, expected a name such as 'whole-body', a "
            "class, or an object with start(snapshot, q_command) and "
            "step(snapshot, reference)"
        )
    if isinstance(controller, partial):
        return name_of(controller.func)
    kind = controller if isinstance(controller, type) else type(controller)
    if "name" in {**vars(kind), **getattr(controller, "__dict__", {})}:
        own = getattr(controller, "name", None)
        if isinstance(own, str) and own:
            return own
    return str(getattr(controller, "__name__", kind.__name__))


def controller_for(plan: RunPlan, controller: Any = None) -> Any:
    """Return the controller of a run; make it if it is a name, a class or a function.

    Args:
        plan: of the run.
        controller: as for :func:`surefoot.simulate`; the plan's when None.

    Raises:
        ControllerError: there is no such controller, or it cannot be made.
        UsageError: an object was made for another servo profile.
    """
    if controller is None or isinstance(controller, str):
        name = controller or plan.controller
        return factory.make_controller(name, plan.robot, plan.settings)
    if not _is_made(controller):
        make = maker_of(name_of(controller), controller)
        return make(plan.robot, plan.settings)
    law = getattr(controller, "inner", controller)
    if isinstance(law, BalanceController):
        made_for = law.model.robot.file.servo.profile
        runs_with = plan.robot.file.servo.profile
        if made_for != runs_with:
            raise UsageError(
                f"controller: got an object made for the servo profile {made_for!r}, "
                f"expected one for that of the run, {runs_with!r}; make it for "
                f"load_robot(..., servo_profile={runs_with!r}), or name its class"
            )
    return controller


def settings_for(controller: Any, settings: Settings) -> ControllerSettings:
    """Resolve the settings of a run; refuse those that would change nothing.

    Args:
        controller: as for :func:`surefoot.simulate`.
        settings: see :data:`surefoot.run_plan.Settings`.

    Raises:
        FileFormatError: a file or a setting is malformed, or the controller of that
            name does not read a setting.
        ControllerError: there is no such controller.
        UsageError: an object, or a class or function without settings, does not get a
            setting.
    """
    given: list[str] = []
    if isinstance(settings, Mapping):
        for name, value in settings.items():
            within = value if isinstance(value, Mapping) else None
            given += [name] if within is None else [f"{name}.{key}" for key in within]
    if isinstance(controller, str):
        factory.check_read(given, [controller], option="settings")
        return resolve_settings(settings, reader=controller)
    resolved = resolve_settings(settings)
    if not _is_made(controller) and takes(controller) > 1:
        return resolved
    if not isinstance(settings, Mapping):
        default = ControllerSettings()
        values = ((n, attrgetter(n)) for n in setting_names())
        given = [n for n, value in values if value(resolved) != value(default)]
    read = factory.read_settings(HoldController.name)  # those of the loop alone
    for name in given:
        if name not in read and not name.startswith("walk."):
            raise UsageError(
                f"settings {name}: {name_of(controller)} would not get it, so that it "
                "would change nothing. Give it to the controller where this is made, "
                "or run a class or function that takes robot and settings"
            )
    return resolved


def _is_made(controller: Any) -> bool:
    """Whether it is an object that controls; otherwise it makes one."""
    return hasattr(controller, "step") and not isinstance(controller, type)


def compute_margins(
    robot: str | Path | Robot = "walker",
    *,
    servo_profile: str | None = None,
    settings: Settings = None,
    delay_ms: float | None = None,
) -> LoopMargins:
    """Compute the margins of the whole-body stabilizer on a standing robot.

    Args:
        robot: shipped name, path of a robot file, or a loaded robot.
        servo_profile: a profile of the robot file to use instead of its own.
        settings: ``{"dik.k_force": -40.0}``, resolved settings, the name of shipped
            settings, a file, or None for the defaults.
        delay_ms: delay of the loop, from a reading to the step in which its answer
            acts, a whole number of ticks; None for one tick [ms].

    Raises:
        UsageError: the delay is not a whole number of ticks.
        RobotFileError: no such robot.
        FileFormatError: a file or a setting is malformed.
    """
    robot = resolve_robot(robot, servo_profile)
    resolved = resolve_settings(settings, reader="whole-body")
    factory.check_settings(resolved, robot)
    ticks = 1
    if delay_ms is not None:
        ticks = _ticks(delay_ms, robot.period_s)
    from surefoot.stabilizer.margins.margins import compute_margins as compute

    return compute(robot, resolved, delay_ticks=ticks)


def loop_delay_ms(delay: Delay, robot: Robot) -> float:
    """Return the delay of sensors and commands together [ms].

    Single sensors may be later than that. The stabilizer sees it by their stamps and
    yields more slowly.
    """
    command_ms = delay.command_ms
    if command_ms is None:
        command_ms = MS_PER_S * robot.period_s
    return command_ms + delay.shared_ms


def loop_notice(plan: RunPlan) -> str:
    """Return a warning if a run's loop is later than robot or stabilizer bear, or "".

    Only the gains of the whole-body stabilizer are judged.
    """
    tick_ms = MS_PER_S * plan.robot.period_s
    delay, shared_ms = plan.scenario.delay, plan.scenario.delay.shared_ms
    whole_ms = loop_delay_ms(delay, plan.robot)
    command_ms = whole_ms - shared_ms
    said = []
    borne_ms = _borne_ms(plan)
    if whole_ms > borne_ms + _WHOLE:
        said.append(
            f"this robot bears {borne_ms:g} ms with these gains and will sway; --set "
            f"dik.loop_delay_s={whole_ms / MS_PER_S:g} makes the feet softer, see "
            "surefoot margins"
        )
    rate_hz = plan.scenario.sensors.force_torque_rate_hz
    between_ms = 0.0 if rate_hz is None else max(0.0, MS_PER_S / rate_hz - tick_ms)
    forces_ms = delay.of("force_torque") - shared_ms + delay.jitter_ms + between_ms
    if forces_ms and whole_ms + forces_ms > borne_ms + _WHOLE:
        said.append(
            f"the foot forces are up to {forces_ms:.3g} ms older than that (rate, "
            "delay, jitter), for which the feet are made softer by themselves; with "
            "play, a payload or offsets besides it may then fall on fast ground"
        )
    gate, enough_s = plan.robot.file.gate, (command_ms + 0.5 * tick_ms) / MS_PER_S
    limits = {
        name: MS_PER_S * limit_s
        for name in ("max_loop_delay_s", "max_command_age_s")
        if (limit_s := getattr(gate, name)) is not None
        and command_ms > MS_PER_S * limit_s + _WHOLE
    }
    if limits:
        changed = " and ".join(f"gate.{name} = {enough_s:g}" for name in limits)
        said.append(
            f"the robot's gate ends a run whose commands are over "
            f"{min(limits.values()):g} ms late, whatever the gains; a copy of the "
            f"robot file with {changed} does not"
        )
    if not said:
        return ""
    late = f"the loop is {whole_ms:g} ms late (commands {command_ms:g}, sensors "
    return f"{late}{shared_ms:g}): {'. And '.join(said)}"


def walk_notice(plan: RunPlan) -> str:
    """Return which part of a run's walk will not be walked; empty if all of it will."""
    walk = plan.walk
    if walk is None:
        return ""
    if not _is_a(plan, *_WALKS):
        is_hold = plan.controller == HoldController.name
        kind = HoldController if is_hold else find_target(plan.controller)
        if inspect.isclass(kind) and not issubclass(kind, Walks):
            return f"no step will be taken: {plan.controller} has no follow_plan(plan)"
        return ""
    from surefoot.stabilizer.walking.step_queue import foretold

    robot, duration_s = plan.robot, plan.scenario.duration_s
    begin_s = walk.begin_tick * robot.period_s
    if not walk.steps:
        return (
            f"no step will be taken: from {begin_s:g} s on ([walk] start_s) there is "
            f"no time for one in the {duration_s:g} s of the run (duration_s)"
        )
    coming = foretold(walk, robot, plan.settings.walk)
    if coming.why:
        return (
            f"no step will be taken: {coming.why}; change [walk], slower or shorter "
            "steps"
        )
    said = []
    if coming.longer > _LONGER:
        said.append(
            f"the legs need {coming.longer:.1f} times as long for a step as asked "
            "(velocity_limit_rad_s of the drives, hips and knees), so the robot walks "
            "or turns that much more slowly; shorter or lower steps are quicker"
        )
    if begin_s + coming.taken_s > duration_s:
        said.append(
            f"the walk will not end: its steps ({len(walk.steps)}) take until "
            f"{begin_s + coming.taken_s:.1f} s at least, and the run {duration_s:g} s "
            "(duration_s)"
        )
    return ". And ".join(said)


def idle_notice(plan: RunPlan) -> str:
    """Return what of a run's scenario does nothing; empty if all of it does."""
    scenario = plan.scenario
    parts: dict[str, Sequence[Push | Rod | Payload | SensorFault | Motion]] = {
        "push": scenario.push,
        "rod": scenario.rod,
        "payload": scenario.payload,
        "fault": scenario.fault,
    }
    for index, platform in enumerate(scenario.platform):
        parts[f"platform[{index}].motion"] = platform.motion
    late = [
        f"{name}[{index}] ({part.start_s:g} s)"
        for name, some in parts.items()
        for index, part in enumerate(some)
        if part.start_s >= scenario.duration_s
    ]
    said = []
    if late:
        said.append(
            f"the run ends at {scenario.duration_s:g} s (duration_s), before this "
            f"begins: {', '.join(late)}; start it earlier, or run longer"
        )
    servo = plan.robot.file.servo
    scale = scenario.model_error.servo_lag_scale
    if scale != 1.0 and plan.robot.servo_profile.lag_s == 0.0:
        slow = [name for name, profile in servo.profiles.items() if profile.lag_s]
        said.append(
            f"servo_lag_scale = {scale:g} changes nothing: servo profile "
            f"{servo.profile!r} has no lag"
            + (f"; --servo-profile {slow[0]} has" if slow else "")
        )
    return ". And ".join(said)


def notices(plan: RunPlan) -> list[str]:
    """Return all that should be told before a run begins."""
    told = (loop_notice, walk_notice, idle_notice)
    return [said for notice in told if (said := notice(plan))]


def _is_a(plan: RunPlan, *shipped: str) -> bool:
    """Return whether its controller is one of these, or a class derived from one."""
    if plan.controller in CONTROLLERS:
        return plan.controller in shipped
    kind = find_target(plan.controller)
    bases = kind.__mro__ if inspect.isclass(kind) else ()
    ours = [base for base in bases if base.__module__.startswith("surefoot.stabilizer")]
    return any(vars(base).get("name") in shipped for base in ours)


def _borne_ms(plan: RunPlan) -> float:
    if not _is_a(plan, "whole-body"):
        return math.inf
    from surefoot.stabilizer.control.drives import borne_delay

    return MS_PER_S * plan.robot.period_s * borne_delay(plan.robot, plan.settings)


def _ticks(delay_ms: float, period_s: float) -> int:
    exact = delay_ms / (MS_PER_S * period_s)
    ticks = round(exact) if math.isfinite(exact) else -1
    if not 0 <= ticks <= MOST_TICKS or abs(exact - ticks) > _OF_A_TICK:
        raise UsageError(
            f"delay: got {delay_ms:g} ms, expected a whole number of ticks of "
            f"{MS_PER_S * period_s:g} ms, 0 to {MOST_TICKS} of them"
        )
    return ticks
