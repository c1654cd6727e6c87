"""Checks of a robot's motions: following commands, and reacting to silence."""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.conformance.evidence import Findings, Recording, Skeleton
from surefoot.robot_io.conformance.probe import Offset, Probe
from surefoot.schemas.arrays import MS_PER_S, Array
from surefoot.schemas.messages import RobotMode
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.sensors import ankle_sensor

MOST_RAD = 1e-3
NUDGE_RAD = 0.7e-3
"""Most that any joint may move in the run, and the step asked of each [rad]."""
RAMP_S = 0.03
STAYS_S = (0.06, 0.3, 0.9)
"""How long a joint is looked for; the later ones where nothing was seen. A command may
be on its way for long, but a joint in another's place follows at no time."""
OTHERS_SHARE = 0.5
LOOK_S = 0.03
SEEN_SHARE = 0.3
LEG_RAMP_S, LEG_STAY_S = 0.2, 0.3
LEAST_SHIFT_N = 2.0
"""Least load that must move to the pushing leg [N]; the stiffest joints give more."""
TOLERANCE_S = 0.15
"""Allowance for the delay of a status and for ticks of a busy machine [s]."""
FAULT_TOLERANCE = 1.3
STOP_S = 0.1
STREAM_S = 0.2


def check_joint_order(probe: Probe, findings: Findings) -> None:
    """Nudge one joint after the other and check that this joint moves.

    Raises:
        RunBrokenOffError: the robot gave us up because our answers came late.
    """
    names = probe.robot.joint_names
    wrong: list[str] = []
    for index in range(probe.robot.n_a):
        is_clear = bool(wrong or probe.was_too_late)  # no more patience will help
        for stay_s in STAYS_S[:1] if is_clear else STAYS_S:
            moved = _nudge(probe, index, stay_s)
            least = max(SEEN_SHARE * NUDGE_RAD, OTHERS_SHARE * np.abs(moved).max())
            if follows := moved[index] >= least:
                break
        if not follows:
            other = int(np.abs(moved).argmax())
            wrong.append(
                f"{names[index]} follows by {moved[index] * 1e3:.2f} mrad, "
                f"{names[other]} by {moved[other] * 1e3:.2f}"
            )
    _need_answers(probe, findings)
    findings.add(
        "joints.order",
        not wrong,
        got=f"not so for {len(wrong)} joints: {wrong[0]}" if wrong else "each does",
        expected=f"a joint asked for {NUDGE_RAD * 1e3:g} mrad follows, by motion or "
        "torque",
    )


def check_foot_order(probe: Probe, findings: Findings) -> None:
    """Lengthen each leg by a hair in turn and check that its foot takes the load.

    Raises:
        RunBrokenOffError: the robot gave us up because our answers came late.
    """
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
    _need_answers(probe, findings)
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


def _need_answers(probe: Probe, findings: Findings) -> None:
    """End the run if the robot gave us up because our answers came late."""
    why = probe.was_too_late
    if why:
        findings.need(
            "commands.rate",
            False,
            got=why,
            expected="an answer in time to every tick; have this computer do less "
            "meanwhile, or ask from another",
        )


def _of_size(rates: Array) -> Array:
    """Zero the rates of joints that hardly lift the sole: they would only twist it."""
    return np.where(np.abs(rates) > 0.3 * np.abs(rates).max(), rates, 0.0)


def _nudge(probe: Probe, index: int, stay_s: float) -> Array:
    """Nudge one joint to and fro; return all set-points' changes, (n_a,) [rad]."""
    step = np.zeros(probe.robot.n_a)
    step[index] = NUDGE_RAD
    if stay_s > STAYS_S[0]:
        probe.stream(stay_s)  # what was asked before may still be on its way
    before = _set_points(probe, probe.stream(LOOK_S))
    probe.stream(RAMP_S + stay_s, offset=_ramp(step, RAMP_S))
    after = _set_points(probe, probe.stream(LOOK_S, offset=lambda t: step))
    probe.stream(RAMP_S, offset=lambda t: step - _ramp(step, RAMP_S)(t))
    followed: Array = after - before
    return followed


def _set_points(probe: Probe, recording: Recording) -> Array:
    """Infer the servos' set-points from positions and torques.

    A joint that the ground holds answers with torque instead of motion, and moves
    others with it. Its servo's set-point is still its own.
    """
    aim: Array = recording.mean("joints", "q")
    return aim + recording.mean("joints", "effort") / probe.robot.kp


def _left_share(probe: Probe, step: Array) -> float:
    """Return left minus right foot load, while a leg is pushed by ``step`` [N]."""
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
    """Return a ramp from 0 to ``step`` that stays there."""
    return lambda t: step * min(t / duration_s, 1.0)


def check_watchdog(probe: Probe, findings: Findings) -> None:
    """Enable, fall silent and wait; leaves the robot in HOLD, with the lease ours.

    Raises:
        RunBrokenOffError: the robot cannot be brought back to HOLD.
    """
    gate = probe.robot.file.gate
    enable(probe, findings, "watchdog.enable")
    begin = probe.now()
    held_s = probe.wait_status(
        lambda s: s.mode is not RobotMode.ACTIVE,
        timeout_s=gate.hold_after_s + 4.0 * TOLERANCE_S,
    )
    status = probe.status
    # A robot on clock time with slow ticks looks quick here.
    is_lease = status is not None and status.cause is ModeCause.LEASE_EXPIRED
    findings.add(
        "watchdog.hold",
        held_s is not None
        and held_s < gate.hold_after_s + TOLERANCE_S
        and not is_lease,
        got=_reaction(held_s, "stays active") + (", by its lease" if is_lease else ""),
        expected=f"not active any more after {gate.hold_after_s * MS_PER_S:g} ms "
        f"without a command (+ {TOLERANCE_S * MS_PER_S:g} ms)",
    )
    limit_s = FAULT_TOLERANCE * gate.fault_after_s + TOLERANCE_S
    is_fault = (
        held_s is not None
        and probe.wait_status(
            lambda s: s.mode is RobotMode.FAULT, timeout_s=limit_s - held_s
        )
        is not None
    )
    fault_s = probe.since(begin)
    hint = ""
    if gate.lease_s < gate.fault_after_s:
        hint = f"; set gate.lease_s, {gate.lease_s:g} s, to that or more: it ends first"
    findings.add(
        "watchdog.fault",
        is_fault,
        got=_reaction(fault_s if is_fault else None, "no fault"),
        expected=f"fault after {gate.fault_after_s:g} s of silence{hint}",
    )
    _recover(probe, findings, "watchdog.reset")


def check_estop(probe: Probe, findings: Findings) -> None:
    """Stop the robot in the name of a bystander without a lease; leaves it in HOLD.

    Raises:
        RunBrokenOffError: the robot cannot be brought back to HOLD.
    """
    enable(probe, findings, "estop.enable")
    begin = probe.now()
    stopped = probe.ask("estop", "", who="a-bystander")
    is_fault = probe.is_mode(RobotMode.FAULT, timeout_s=STOP_S)
    took_s = probe.since(begin)
    findings.add(
        "estop.reaction",
        stopped.accepted and is_fault and took_s < STOP_S + TOLERANCE_S,
        got=stopped.detail or _reaction(took_s if is_fault else None, "no fault"),
        expected=f"fault within {(STOP_S + TOLERANCE_S) * MS_PER_S:g} ms, for anyone",
    )
    again = probe.ask("mode", "enable")
    probe.stream(STREAM_S)
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.add(
        "estop.latched",
        not again.accepted and mode is RobotMode.FAULT,
        got=f"{again.detail or 'enabled'}; {mode}",
        expected="neither enabling nor commanding leaves the fault",
    )
    _recover(probe, findings, "estop.reset")


def enable(probe: Probe, findings: Findings, name: str) -> None:
    """Enable the robot.

    Raises:
        RunBrokenOffError: the robot does not follow.
    """
    enabled = probe.start()
    follows = probe.stream_until_active()
    mode = probe.status.mode if probe.status is not None else "silent"
    findings.need(
        name,
        enabled.accepted and follows,
        got=enabled.detail or str(mode),
        expected="active, once the holder of the lease asks",
    )


def _recover(probe: Probe, findings: Findings, name: str) -> None:
    """Take the lease again, reset the fault if there is one, and check for HOLD."""
    taken = probe.ask("lease", "take")
    status = probe.status
    if status is not None and status.mode is RobotMode.FAULT:
        answer = probe.ask("mode", "reset")
    else:
        answer = probe.ask("mode", "hold")
    is_held = probe.is_mode(RobotMode.HOLD)
    findings.need(
        name,
        taken.accepted and answer.accepted and is_held,
        got=taken.detail or answer.detail or ("hold" if is_held else "no hold"),
        expected="hold again, once the holder of the lease resets",
    )


def _reaction(took_s: float | None, otherwise: str) -> str:
    return otherwise if took_s is None else f"after {took_s * MS_PER_S:.0f} ms"
