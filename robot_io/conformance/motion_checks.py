"""Is the robot wired as its files say: joint order, feet. Moves below a milliradian."""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.conformance.check_result import Findings
from surefoot.robot_io.conformance.probe import Offset, Probe, Recording
from surefoot.robot_io.conformance.skeleton import Skeleton
from surefoot.schemas.arrays import Array
from surefoot.schemas.sensors import ankle_sensor

MOST_RAD = 1e-3
NUDGE_RAD = 0.7e-3
"""What a joint is asked to move, and how much of it must be seen."""
RAMP_S, STAY_S = 0.03, 0.06
OTHERS_SHARE = 0.5
LOOK_S = 0.03
SEEN_SHARE = 0.3
LEG_RAMP_S, LEG_STAY_S = 0.2, 0.3
LEAST_SHIFT_N = 2.0
"""Load that must go over to the leg that pushes; the stiffest joints give more."""


def check_joint_order(probe: Probe, findings: Findings) -> None:
    """Nudge one joint after the other and look which one moves."""
    names = probe.robot.joint_names
    wrong = []
    for index in range(probe.robot.n_a):
        moved = _nudge(probe, index)
        least = max(SEEN_SHARE * NUDGE_RAD, OTHERS_SHARE * np.abs(moved).max())
        if moved[index] < least:
            other = int(np.abs(moved).argmax())
            wrong.append(
                f"{names[index]} follows by {moved[index] * 1e3:.2f} mrad, "
                f"{names[other]} by {moved[other] * 1e3:.2f}"
            )
    findings.add(
        "joints.order",
        not wrong,
        got=f"not so for {len(wrong)} joints: {wrong[0]}" if wrong else "each does",
        expected=f"a joint asked for {NUDGE_RAD * 1e3:g} mrad follows, by motion or "
        "torque",
    )


def check_foot_order(probe: Probe, findings: Findings) -> None:
    """Make the left leg longer by a hair and look which foot takes the load."""
    robot = probe.robot
    skeleton = Skeleton(robot)
    push = {
        foot.side: -NUDGE_RAD
        * np.sign(_of_size(skeleton.sole_height_rates(foot, probe.q_held)))
        for foot in robot.file.foot
    }
    before = _left_share(probe, 0.0 * push["left"])
    left = _left_share(probe, push["left"]) - before
    right = _left_share(probe, push["right"]) - before
    findings.add(
        "feet.order",
        left > LEAST_SHIFT_N and right < -LEAST_SHIFT_N,
        got=f"left takes over {left:+.1f} N when the left leg pushes, {right:+.1f} N "
        "when the right one does",
        expected=f"above +{LEAST_SHIFT_N:g} and below -{LEAST_SHIFT_N:g} N",
    )


def check_motion(probe: Probe, findings: Findings) -> None:
    """Check that the run so far has not moved the robot."""
    findings.add(
        "moved",
        probe.moved_rad < MOST_RAD,
        got=f"{probe.moved_rad * 1e3:.3f} mrad at most, of any joint",
        expected=f"below {MOST_RAD * 1e3:g} mrad over the whole run",
    )


def _of_size(rates: Array) -> Array:
    """Leave joints alone that hardly lift the sole: they would only twist it."""
    return np.where(np.abs(rates) > 0.3 * np.abs(rates).max(), rates, 0.0)


def _nudge(probe: Probe, index: int) -> Array:
    """Nudge one joint and back; return how far all joints followed, (n_a,) [rad]."""
    step = np.zeros(probe.robot.n_a)
    step[index] = NUDGE_RAD
    before = _set_points(probe, probe.stream(LOOK_S))
    probe.stream(RAMP_S + STAY_S, offset=_ramp(step, RAMP_S))
    after = _set_points(probe, probe.stream(LOOK_S, offset=lambda t: step))
    probe.stream(RAMP_S, offset=lambda t: step - _ramp(step, RAMP_S)(t))
    followed: Array = after - before
    return followed


def _set_points(probe: Probe, recording: Recording) -> Array:
    """Infer the servos' set-points from positions and torques.

    A joint that the ground holds answers with torque instead of motion, and takes
    others along; its servo's aim still is its own.
    """
    aim: Array = recording.mean("joints", "q")
    return aim + recording.mean("joints", "effort") / probe.robot.kp


def _left_share(probe: Probe, step: Array) -> float:
    """Load of the left foot beyond the right one's, with a leg pushed [N]."""
    probe.stream(LEG_RAMP_S + LEG_STAY_S, offset=_ramp(step, LEG_RAMP_S))
    recording = probe.stream(LEG_STAY_S, offset=lambda t: step)
    probe.stream(LEG_RAMP_S, offset=lambda t: step - _ramp(step, LEG_RAMP_S)(t))
    robot = probe.robot
    left, right = (
        normal @ recording.mean(ankle_sensor(foot.side).name, "force")
        for foot, normal in zip(robot.file.foot, robot.sole_normals, strict=True)
    )
    return float(left - right)


def _ramp(step: Array, duration_s: float) -> Offset:
    """Return a ramp from 0 to ``step`` that then stays there."""
    return lambda t: step * min(t / duration_s, 1.0)
