"""Measures ankle sensor offsets (``surefoot tare``) and drives (``identify``)."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
import tomli_w

from surefoot.errors import ChildFailedError, ExitCode, UsageError
from surefoot.out_folder import check_replaceable, make_out_folder, new_file
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.conformance.evidence import Recording
from surefoot.robot_io.realtime import Pace, StopRequest
from surefoot.robot_io.robot import (
    EXTENDS,
    Robot,
    Tare,
    extended_file,
    load_tare,
    save_tare,
)
from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout
from surefoot.schemas.arrays import Array, Vec6
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.reasons import EndReason, Outcome, in_words
from surefoot.schemas.robot_file import ServoProfile, Side
from surefoot.schemas.scenario import Scenario
from surefoot.schemas.sensors import ankle_sensor
from surefoot.schemas.settings import ControllerSettings
from surefoot.schemas.toml_file import read_toml
from surefoot.schemas.validation import nearest
from surefoot.simulation import Simulation
from surefoot.stabilizer.estimation.wrenches import foot_offsets
from surefoot.stabilizer.identification import SEEN_SHARE, Drive, IdentifyController
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.node import run_stabilizer
from surefoot.stabilizer.walking.footsteps import SIDES

FootChoice = Literal["left", "right", "both"]
CHANNELS = ("joints", "imu", "left_ankle_ft", "right_ankle_ft")
LARGEST_OFFSET_N, LARGEST_OFFSET_WEIGHTS = 100.0, 0.25
"""With a larger offset a foot stands, or its sensor is broken [N, robot weights]."""
LARGEST_SCATTER_N = 20.0
"""Standard deviation above which a foot counts as moving [N]."""
FEWEST_READINGS = 20
PROFILE = "identified"
SIGNATURE = "by surefoot identify"
AMPLITUDE_RAD = 0.02
LEAST_STIFFNESS = 0.1
"""Share of the robot file's stiffness below which a drive did not follow [1]."""
LARGEST_AMPLITUDE_RAD = 0.05
"""A leg that moves further would lift its foot [rad]."""


class TareFound(NamedTuple):
    """Offsets that were measured and stored.

    Attributes:
        path: file with the offsets.
        found: (2, 6) offsets found on top of the former ones, left and right [N, N m].
        tare: all offsets, as stored.
        readings: number of readings behind the mean.
    """

    path: Path
    found: Array
    tare: Tare
    readings: int


def measure_tare(
    robot: Robot,
    *,
    endpoints: Endpoints,
    foot: FootChoice = "both",
    duration_s: float = 2.0,
    timeout_s: float = 10.0,
) -> TareFound:
    """Measure and store the ankle sensors' offsets of a robot with its feet in the air.

    The robot is at rest; nothing is commanded. The driver subtracts the offsets from
    its next start on.

    Args:
        robot: the robot as its files describe it; the offsets go beside its TOML.
        endpoints: where to find it.
        foot: the foot, or both, that hangs free.
        duration_s: duration of the average [s].
        timeout_s: longest wait for the robot [s].

    Raises:
        RobotIoError: there is no robot.
        UsageError: a foot stands or moves, too few readings came, or the robot has no
            ankle sensors.
        OSError: the file cannot be written.
    """
    if robot.file.virtual_ft is not None:
        raise UsageError(
            f"tare: {robot.file.name} has no ankle sensors: it works its foot forces "
            "out from its joints ([virtual_ft]), which have no such offsets"
        )
    model = RobotModel(robot)
    limit_n = min(LARGEST_OFFSET_N, LARGEST_OFFSET_WEIGHTS * model.weight)
    heard = Recording(joint_count=robot.n_a)
    with Observer(robot, endpoints=endpoints, channels=CHANNELS, depth=64) as observer:
        observer.connect(timeout_s=timeout_s)
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s and not observer.has_left():
            for sample in observer.take(timeout_s=0.1):
                heard.add(sample.channel, sample.data)
        instance = observer.robot_instance
    counts = {channel: len(heard.read(channel).messages) for channel in CHANNELS}
    fewest = min(counts.values())
    if fewest < FEWEST_READINGS:
        got = ", ".join(f"{count} of {channel}" for channel, count in counts.items())
        raise UsageError(
            f"tare: got {got} in {duration_s:g} s, expected {FEWEST_READINGS} or more "
            "readings of each; measure for longer, or look with surefoot hz what comes "
            "(a simulated robot is silent until somebody commands it)"
        )
    wrenches = {side: _wrenches(heard, side) for side in SIDES}
    found = foot_offsets(model, _mean(robot, heard, wrenches))
    measured: dict[Side, Vec6] = {}
    for side, name in enumerate(SIDES):
        if foot not in (name, "both"):
            found[side] = 0.0
            continue
        measured[name] = found[side]
        force = float(np.linalg.norm(found[side, :3]))
        scatter = float(np.std(wrenches[name], axis=0)[:3].max())
        if force > limit_n or scatter > LARGEST_SCATTER_N:
            raise UsageError(
                f"tare: the {name} foot feels {force:.0f} N, changing by {scatter:.0f} "
                f"N, expected at most {limit_n:.0f} N and {LARGEST_SCATTER_N:g} "
                "N of a foot that touches nothing and is at rest; lift the robot, or "
                "one foot and name it with --foot"
            )
    tare = load_tare(robot.path).measured(
        measured,
        robot=robot.file.name,
        instance=instance,
        day=time.strftime("%Y-%m-%d"),
    )
    return TareFound(save_tare(robot.path, tare), found, tare, fewest)


def _wrenches(heard: Recording, side: Side) -> Array:
    """(readings, 6) forces and moments of an ankle sensor [N, N m]."""
    name = ankle_sensor(side).name
    return np.hstack([heard.column(name, part) for part in ("force", "moment")])


def _mean(robot: Robot, heard: Recording, wrenches: dict[Side, Array]) -> Snapshot:
    layout = SnapshotLayout(robot.n_a)
    return replace(
        layout.view(0, 0, np.zeros(layout.size)),
        q=heard.mean("joints", "q"),
        linear_acceleration=heard.mean("imu", "linear_acceleration"),
        ft_left=wrenches["left"].mean(axis=0),
        ft_right=wrenches["right"].mean(axis=0),
    )


def choose_joints(robot: Robot, names: Sequence[str]) -> list[int]:
    """Return the indices of named joints in bus order; all joints if none is named.

    Raises:
        UsageError: there is no such joint.
    """
    known = robot.joint_names
    for name in names:
        if name not in known:
            raise UsageError(
                f"--joint {name}: {robot.file.name} has no such joint"
                f"{nearest(name, known)}; it has {', '.join(known)}"
            )
    return [known.index(name) for name in names or known]


def identify_drives(
    robot: Robot,
    *,
    joints: Sequence[str] = (),
    amplitude_rad: float = AMPLITUDE_RAD,
    endpoints: Endpoints | None = None,
    pace: Pace = Pace.REALTIME,
    scenario: Scenario | None = None,
    timeout_s: float = 10.0,
) -> list[Drive]:
    """Move a standing robot's joints a little, one by one, and identify their drives.

    Args:
        robot: the robot as its files describe it; it stands on both feet, at rest.
        joints: by name; all when empty.
        amplitude_rad: of the motion [rad].
        endpoints: where to find it; None for a simulated one in this process.
        pace: of the robot on the bus.
        scenario: of the simulated robot; None: it stands as its file says.
        timeout_s: longest wait for it on the bus [s].

    Returns:
        One row per joint.

    Raises:
        UsageError: no such joint, or the amplitude is too large.
        RobotIoError: there is no robot on the bus.
        ChildFailedError: the robot fell or gave up before the end; or a joint was seen
            too seldom, or did not follow.
    """
    if scenario is not None and (scenario.platform or scenario.push or scenario.walk):
        raise UsageError(
            f"--scenario {scenario.name}: its ground or its pushes move the robot, or "
            "it walks; drives are told from a robot that stands on firm, level ground"
        )
    if not 0.0 < amplitude_rad <= LARGEST_AMPLITUDE_RAD:
        raise UsageError(
            f"--amplitude {amplitude_rad:g}: expected more than 0 and at most "
            f"{LARGEST_AMPLITUDE_RAD:g} rad, or a foot may lift"
        )
    chosen = choose_joints(robot, joints)

    def make(settings: ControllerSettings) -> IdentifyController:
        del settings
        return IdentifyController(robot, chosen, amplitude_rad=amplitude_rad)

    if endpoints is None:
        controller, why, code = _in_simulation(robot, make, scenario)
    else:
        controller, why, code = _on_bus(robot, make, endpoints, pace, timeout_s)
    if not controller.is_done or code is not ExitCode.OK:
        raise ChildFailedError(
            f"identify: it ended with {controller.progress:.0%} of the joints moved: "
            f"{why}; nothing was written. Have the robot stand on both feet on firm, "
            "level ground, or try a smaller --amplitude",
            exit_code=code,
        )
    return judged(controller, amplitude_rad=amplitude_rad)


def judged(controller: IdentifyController, *, amplitude_rad: float) -> list[Drive]:
    """Return the identified drives: all of them, or an error.

    Args:
        controller: the one that has moved the joints.
        amplitude_rad: of the motion [rad].

    Raises:
        ChildFailedError: a joint was seen too seldom, or did not follow.
    """
    if controller.unseen:
        raise ChildFailedError(
            f"identify: of the motion of {', '.join(controller.unseen)} less than "
            f"{SEEN_SHARE:.0%} of the ticks were answered: this machine, or the link, "
            "is too slow; nothing was written. Stop what else runs here",
            exit_code=ExitCode.FAILED,
        )
    drives = controller.found()
    for drive in drives:
        stiffness = 1.0 if drive.stiffness_scale is None else drive.stiffness_scale
        if not stiffness > LEAST_STIFFNESS or drive.backlash_rad > amplitude_rad:
            raise ChildFailedError(
                f"identify: {drive.joint} did not follow its commands (stiffness "
                f"{stiffness:.2f} of the robot file's, play {drive.backlash_rad:.3f} "
                "rad); nothing was written. Does the robot's gate let commands pass, "
                "and is the joint free to move?",
                exit_code=ExitCode.FAILED,
            )
    return drives


class _Ended(NamedTuple):
    controller: IdentifyController
    why: str
    code: ExitCode


def _in_simulation(
    robot: Robot,
    make: Callable[[ControllerSettings], IdentifyController],
    scenario: Scenario | None,
) -> _Ended:
    controller = make(ControllerSettings())
    seconds = controller.duration_s + 1.0
    base = scenario or Scenario(name="identify", duration_s=seconds)
    sim = Simulation(robot, msgspec.structs.replace(base, duration_s=seconds))
    while not (sim.finished or controller.is_done):
        if sim.step(controller) is None:
            break
    result = sim.result()
    code = ExitCode.FELL if sim.fell else ExitCode.FAILED
    has_followed = result.outcome not in (Outcome.FELL, Outcome.FAULT, Outcome.HELD)
    if controller.is_done and has_followed:
        code = ExitCode.OK
    return _Ended(controller, result.outcome_detail or str(result.outcome), code)


def _on_bus(
    robot: Robot,
    make: Callable[[ControllerSettings], IdentifyController],
    endpoints: Endpoints,
    pace: Pace,
    timeout_s: float,
) -> _Ended:
    stop = StopRequest()
    made: list[IdentifyController] = []

    def watched(settings: ControllerSettings) -> IdentifyController:
        made.append(make(settings))
        made[-1].on_end = lambda: stop.set("all joints have been moved")
        return made[-1]

    result = run_stabilizer(
        watched,
        robot,
        endpoints=endpoints,
        pace=pace,
        connect_timeout_s=timeout_s,
        stop=stop,
    )
    done = [one for one in made if one.is_done]
    if not done and result.end is EndReason.STOPPED:
        raise ChildFailedError(
            "identify: interrupted; nothing was written", exit_code=ExitCode.INTERRUPTED
        )
    code = ExitCode.FELL if result.end is EndReason.FELL else ExitCode.FAILED
    code = ExitCode.OK if done else code
    why = in_words(result.end, result.end_detail)
    return _Ended((done or made)[-1], why, code)


def profile_of(robot: Robot, drives: Sequence[Drive]) -> ServoProfile:
    """Return one profile for all drives: median lag, lowest speed limit that showed.

    If leg drives were moved, only these count: legs balance, arms have other drives.
    If no limit showed, it is the larger of the robot's own limit and the smallest
    speed that a drive reached.
    """
    model = RobotModel(robot)
    at = np.flatnonzero(model.is_leg[model.to_bus])
    legs = {robot.joint_names[i] for i in at}
    drives = [drive for drive in drives if drive.joint in legs] or drives
    speeds = [drive.velocity_limit_rad_s for drive in drives if not drive.is_bound]
    if not speeds:
        reached = min(drive.velocity_limit_rad_s for drive in drives)
        speeds = [max(reached, robot.servo_profile.velocity_limit_rad_s)]
    return ServoProfile(
        velocity_limit_rad_s=round(min(speeds), 3),
        lag_s=round(float(np.median([drive.lag_s for drive in drives])), 5),
    )


def check_out(robot: Robot, out: Path, *, overwrite: bool) -> None:
    """Refuse an output path that cannot be written or read, before anything moves.

    Raises:
        UsageError: the path is taken or no robot file, or its folder does not exist.
        EnvironmentFailedError: nothing can be written there.
        FileFormatError: the file with the robot's offsets is malformed.
    """
    if out.suffix != ".toml":
        raise UsageError(f"--out {out}: expected the name of a robot file (.toml)")
    load_tare(robot.path)
    check_replaceable(out, signature=SIGNATURE, overwrite=overwrite)
    if not out.parent.is_dir():
        raise UsageError(f"--out {out}: there is no folder {out.parent}")
    make_out_folder(out.parent, out=out)


def write_profile(
    robot: Robot, drives: Sequence[Drive], out: Path, *, overwrite: bool = False
) -> ServoProfile:
    """Write a robot file that extends the robot's by the identified drives.

    If the robot's file itself extends another one, the new file extends that one and
    repeats the rest. The ankle sensors' offsets are stored beside the new file, unless
    there are some that were measured for it.

    Raises:
        UsageError: the file exists.
        OSError: it cannot be written.
    """
    profile, tare = profile_of(robot, drives), load_tare(robot.path)
    profiles = {**robot.file.servo.profiles, PROFILE: profile}
    servo = {"profile": PROFILE, "profiles": msgspec.to_builtins(profiles)}
    source = read_toml(robot.path)
    below, table = robot.path, dict[str, Any]()
    if EXTENDS in source:
        below = extended_file(robot.path, str(source.pop(EXTENDS)))
        table = source
    start = out.resolve().parent
    table = {EXTENDS: os.path.relpath(below.resolve(), start), **table, "servo": servo}
    if "urdf" in table:
        table["urdf"] = os.path.relpath(robot.urdf_path, start)
    lines = [f"# Drives of {robot.file.name}, {SIGNATURE}."]
    lines += [f"# {line}" for line in in_lines(drives)]
    with new_file(out, overwrite=overwrite) as file:
        file.write(("\n".join(lines) + "\n\n" + tomli_w.dumps(table)).encode())
    if not tare.is_zero:
        save_tare(out, tare, overwrite=False)
    return profile


def in_lines(drives: Sequence[Drive]) -> list[str]:
    """Return one line of text per drive."""
    return [
        f"{drive.joint}: lag {1e3 * drive.lag_s:.1f} ms, "
        f"{'at least ' if drive.is_bound else ''}{drive.velocity_limit_rad_s:g} rad/s, "
        f"play {'at most ' if drive.backlash_is_bound else ''}"
        f"{1e3 * drive.backlash_rad:.2f} mrad"
        for drive in drives
    ]
