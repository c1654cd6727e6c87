"""Checks of a robot's messages: rates, stamps, ticks and plausible values."""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.conformance.evidence import Findings, Recording, Skeleton
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import OTHER_CLOCK_NS
from surefoot.schemas.arrays import (
    GRAVITY_M_S2,
    MS_PER_NS,
    MS_PER_S,
    NS_PER_S,
    Array,
    Vec3,
)
from surefoot.schemas.messages import ImuState, RobotStatus
from surefoot.schemas.sensors import SENSORS, Sensor, ankle_sensor, of_kind

RATE_TOLERANCE = 0.1
LOST_SHARE = 0.05
"""Share of ticks that may lack a message."""
JITTER_PERIODS = 0.5
"""Median error of the period, in periods; the worst may reach the watchdog's limit."""
ACCELERATION_TOLERANCE_M_S2 = 0.5
TILT_TOLERANCE_RAD = 0.2
GYRO_TOLERANCE_RAD_S = 0.2
WEIGHT_TOLERANCE = 0.15
LEAST_SHARE = 0.1
"""Least share of the weight on each foot of a standing robot."""
SERVO_ERROR_RAD = 0.1
QUATERNION_TOLERANCE = 0.01
STATUS_APART_S = 1.0
"""Longest lateness of a busy robot's status [s]."""


def check_messages(
    robot: Robot,
    recording: Recording,
    findings: Findings,
    *,
    status: RobotStatus | None = None,
) -> None:
    """Check each channel by itself; needs one second of messages.

    Args:
        robot: the robot of the files.
        recording: sensor messages.
        findings: receives the results.
        status: a status that came meanwhile.

    Raises:
        RunBrokenOffError: a channel is silent, so its values cannot be checked.
    """
    for entry in SENSORS:
        name = entry.name
        _check_form(name, recording, findings)
        ticks = recording.column(name, "tick")
        stamps_s = recording.column(name, "stamp_ns") / NS_PER_S
        _check_order(name, ticks, stamps_s, findings)
        _check_rate(robot, name, ticks, stamps_s, findings)
        if entry.side is None or robot.file.virtual_ft is None:
            _check_life(entry, recording, findings)
    _check_clock(recording, status, findings)
    _check_jitter(robot, recording, findings)


def _check_form(name: str, recording: Recording, findings: Findings) -> None:
    read = recording.read(name)
    count, bad = len(read.messages), read.malformed
    why = f", {bad} unreadable: {read.error}" if bad else ""
    findings.need(
        f"{name}.format",
        count > 1 and not bad,
        got=f"{count} messages{why}",
        expected="messages that follow the schema, finite, one number per joint",
    )


def _check_order(name: str, ticks: Array, stamps_s: Array, findings: Findings) -> None:
    steps, gaps = np.diff(ticks), np.diff(stamps_s)
    findings.add(
        f"{name}.tick",
        bool((steps > 0).all()),
        got=f"steps of {steps.min()} to {steps.max()}",
        expected="counts up with every message",
    )
    findings.add(
        f"{name}.stamp",
        bool((gaps >= 0.0).all() and gaps.max() > 0.0),
        got=f"steps of {gaps.min() * MS_PER_S:.3f} to {gaps.max() * MS_PER_S:.3f} ms",
        expected="never goes back; a reading sent again keeps its stamp",
    )


def _check_rate(
    robot: Robot, name: str, ticks: Array, stamps_s: Array, findings: Findings
) -> None:
    wanted = robot.file.rate_hz
    span_s = max(float(stamps_s[-1] - stamps_s[0]), 1e-9)
    rate = (len(ticks) - 1) / span_s
    lost = 1.0 - len(ticks) / max(float(ticks[-1] - ticks[0]) + 1.0, float(len(ticks)))
    findings.add(
        f"{name}.rate",
        abs(rate / wanted - 1.0) < RATE_TOLERANCE and lost < LOST_SHARE,
        got=f"{rate:.1f} Hz, {lost:.1%} of the ticks missing",
        expected=f"{wanted:g} Hz, a message at every tick",
    )


def _check_life(entry: Sensor, recording: Recording, findings: Findings) -> None:
    """Look for values that never change, in each quantity of a sensor that should."""
    changing = {
        quantity.attribute: int(
            (np.ptp(recording.column(entry.name, quantity.attribute), axis=0) > 0).sum()
        )
        for quantity in entry.quantities
        if quantity.trembles
    }
    # A gyroscope may be dead by itself; drives need not report their effort.
    needs_all = entry.message is ImuState
    lives = (all if needs_all else any)(changing.values())
    findings.add(
        f"{entry.name}.alive",
        lives,
        got=", ".join(f"{count} of {name}" for name, count in changing.items())
        + " change at all",
        expected="a sensor's last digits move; equal ones for a second are stuck",
    )


def _check_clock(
    recording: Recording, status: RobotStatus | None, findings: Findings
) -> None:
    """Compare the stamps of messages of the same tick."""
    joints, *others = (
        dict(
            zip(
                recording.column(entry.name, "tick").tolist(),
                recording.column(entry.name, "stamp_ns").tolist(),
                strict=True,
            )
        )
        for entry in SENSORS
    )
    apart_ms = {
        entry.name: MS_PER_NS
        * max((abs(stamps[t] - joints[t]) for t in stamps.keys() & joints), default=0)
        for entry, stamps in zip(SENSORS[1:], others, strict=True)
    }
    name, most_ms = max(apart_ms.items(), key=lambda item: item[1])
    findings.add(
        "clock",
        most_ms <= MS_PER_NS * OTHER_CLOCK_NS,
        got=f"{name} is stamped {most_ms:.3f} ms from the joints",
        expected="one clock for all sensors, when each measured; those of one tick are "
        f"within {MS_PER_NS * OTHER_CLOCK_NS:g} ms",
    )
    if status is not None and status.tick in joints:
        apart_s = abs(status.stamp_ns - joints[status.tick]) / NS_PER_S
        findings.add(
            "status.clock",
            apart_s <= STATUS_APART_S,
            got=f"stamped {apart_s:.3f} s from the joints of its tick",
            expected=f"the sensors' clock: within {STATUS_APART_S:g} s",
        )


def _check_jitter(robot: Robot, recording: Recording, findings: Findings) -> None:
    stamps_s = recording.column("joints", "stamp_ns") / NS_PER_S
    ticks = recording.column("joints", "tick")
    period_s = robot.period_s
    errors = np.abs(np.diff(stamps_s) - np.diff(ticks) * period_s)
    median, p99 = np.quantile(errors, (0.5, 0.99))
    limit_s = robot.file.gate.hold_after_s
    findings.add(
        "joints.jitter",
        bool(median < JITTER_PERIODS * period_s and p99 < limit_s),
        got=f"median {median * MS_PER_S:.3f} ms, 99 % {p99 * MS_PER_S:.3f} ms",
        expected=f"below {JITTER_PERIODS * period_s * MS_PER_S:g} and "
        f"{limit_s * MS_PER_S:g} ms, the watchdog's patience",
    )


def check_values(
    robot: Robot, recording: Recording, q_held: Array, findings: Findings
) -> None:
    """Check a recording of a robot that stands still and upright on both feet.

    Args:
        robot: the robot of the files.
        recording: about a second of sensor messages.
        q_held: (n_a,) posture that its servos follow [rad].
        findings: receives the results.
    """
    _check_joints(robot, recording, q_held, findings)
    for unit in of_kind(ImuState):
        _check_imu(unit.name, recording, findings)
    if robot.file.virtual_ft is None:
        _check_feet(robot, recording, findings)
    else:
        _check_efforts(recording, findings)


def _check_joints(
    robot: Robot, recording: Recording, q_held: Array, findings: Findings
) -> None:
    q = recording.mean("joints", "q")
    names = robot.joint_names
    beyond = np.maximum(robot.lower - q, q - robot.upper)
    worst = int(beyond.argmax())
    findings.add(
        "joints.range",
        beyond[worst] <= 0.0,
        got=f"{names[worst]} at {q[worst]:.4f}",
        expected=f"within {robot.lower[worst]:.4f} to {robot.upper[worst]:.4f} rad",
    )
    error = np.abs(q - q_held)
    worst = int(error.argmax())
    ratio = q[worst] / q_held[worst] if q_held[worst] else 0.0
    hint = "; degrees?" if 40.0 < ratio < 75.0 else "; sign?" if ratio < 0.0 else ""
    findings.add(
        "joints.position",
        error[worst] < SERVO_ERROR_RAD,
        got=f"{names[worst]} at {q[worst]:.4f}{hint}",
        expected=f"within {SERVO_ERROR_RAD:g} rad of the held {q_held[worst]:.4f}",
    )
    effort = np.abs(recording.mean("joints", "effort")) / robot.torque_limit
    worst = int(effort.argmax())
    findings.add(
        "joints.effort",
        effort[worst] <= 1.0,
        got=f"{names[worst]} at {effort[worst]:.0%} of its limit",
        expected="torques in N m, within the limits",
    )


def _check_imu(name: str, recording: Recording, findings: Findings) -> None:
    quaternions = recording.column(name, "quat_xyzw")
    norms = np.linalg.norm(quaternions, axis=1)
    findings.add(
        f"{name}.quaternion",
        bool(np.abs(norms - 1.0).max() < QUATERNION_TOLERANCE),
        got=f"norm {norms.min():.4f} to {norms.max():.4f}",
        expected="a unit quaternion",
    )
    acceleration = recording.mean(name, "linear_acceleration")
    size = float(np.linalg.norm(acceleration))
    hint = "; in g?" if abs(size - 1.0) < 0.1 else ""
    findings.add(
        f"{name}.gravity",
        abs(size - GRAVITY_M_S2) < ACCELERATION_TOLERANCE_M_S2,
        got=f"{size:.3f} m/s^2{hint}",
        expected=f"{GRAVITY_M_S2} m/s^2 at rest",
    )
    up = _turned(quaternions.mean(axis=0), acceleration) / max(size, 1e-9)
    tilt = float(np.arccos(np.clip(up[2], -1.0, 1.0)))
    findings.add(
        f"{name}.attitude",
        tilt < TILT_TOLERANCE_RAD,
        got=f"quaternion and accelerometer differ by {np.degrees(tilt):.1f} deg",
        expected=f"below {np.degrees(TILT_TOLERANCE_RAD):.1f} deg (order x y z w; "
        "specific force points up)",
    )
    rate = float(np.linalg.norm(recording.mean(name, "angular_velocity")))
    findings.add(
        f"{name}.gyroscope",
        rate < GYRO_TOLERANCE_RAD_S,
        got=f"{rate:.4f} rad/s",
        expected=f"below {GYRO_TOLERANCE_RAD_S} rad/s at rest",
    )


def _turned(quat_xyzw: Array, v: Vec3) -> Vec3:
    """Return a vector rotated by a quaternion of approximately unit norm."""
    xyz, w = quat_xyzw[:3], quat_xyzw[3]
    turned: Vec3 = v + 2.0 * np.cross(xyz, np.cross(xyz, v) + w * v)
    return turned


def _check_efforts(recording: Recording, findings: Findings) -> None:
    """Check that joints report efforts; without ankle sensors they tell the weight."""
    largest = float(np.abs(recording.mean("joints", "effort")).max())
    findings.add(
        "feet.efforts",
        largest > 0.0,
        got=f"{largest:.1f} N m at most, of any joint",
        expected="measured: the ankles' wrenches are inferred from them ([virtual_ft])",
    )


def _check_feet(robot: Robot, recording: Recording, findings: Findings) -> None:
    skeleton = Skeleton(robot)
    below_kg = sum(map(skeleton.mass_below_sensor_kg, robot.file.foot))
    weight_n = (skeleton.mass_kg - below_kg) * GRAVITY_M_S2
    ankles = [ankle_sensor(foot.side).name for foot in robot.file.foot]
    loads = [
        float(normal @ recording.mean(ankle, "force"))
        for ankle, normal in zip(ankles, robot.sole_normals, strict=True)
    ]
    for ankle, load_n in zip(ankles, loads, strict=True):
        findings.add(
            f"{ankle}.sign",
            load_n > LEAST_SHARE * weight_n,
            got=f"{load_n:.1f} N along the sole's normal",
            expected="positive: the ground pushes the ankle up, by a share of "
            f"{weight_n:.0f} N",
        )
    findings.add(
        "feet.weight",
        abs(sum(loads) / weight_n - 1.0) < WEIGHT_TOLERANCE,
        got=f"{sum(loads):.1f} N in all",
        expected=f"{weight_n:.1f} N, the weight above the sensors",
    )
