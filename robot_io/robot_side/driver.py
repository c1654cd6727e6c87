"""The loop of a hardware driver: a vendor's SDK on one side, the bus on the other."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.realtime import (
    CommandLatency,
    Pacer,
    StopRequest,
    TimingLog,
    quiet_interpreter,
)
from surefoot.robot_io.robot import Robot, load_tare
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.robot_io.snapshot import Snapshot
from surefoot.schemas.arrays import Array
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.reasons import ModeCause

_LOG = logging.getLogger(__name__)


class VendorAdapter(Protocol):
    """What a vendor's robot must offer; in our joint order, units, signs and frames.

    Both are called once per tick, by the loop alone, and must not block for longer
    than a fraction of it.
    """

    def read(self, tick: int, stamp_ns: int) -> Snapshot:
        """Take a reading of all sensors.

        Args:
            tick: counts the robot's periods; passed on.
            stamp_ns: monotonic clock now; passed on, or a better one put instead, of
                one clock for all sensors [ns].
        """
        ...

    def write(self, q_command: Array) -> None:
        """Have the servos follow a posture.

        Args:
            q_command: (n_a,) what the gate let pass, every tick, also in HOLD [rad].
        """
        ...


@runtime_checkable
class PacingAdapter(VendorAdapter, Protocol):
    """One whose robot sends readings at its own pace, each sensor for itself.

    Attributes:
        missing: channels that the reading last taken has nothing new enough of; they
            are not sent, so that the stabilizer learns of it.
    """

    missing: tuple[str, ...]

    def wait(self) -> None:
        """Return at the robot's next reading, or when it has been silent for long."""
        ...


class GateFactory(Protocol):
    """Makes the guard in front of the servos."""

    def __call__(self, robot: Robot, posture: Array) -> CommandGate:
        """Start in HOLD at a posture."""
        ...


def run_driver(
    adapter: VendorAdapter,
    robot: Robot,
    *,
    endpoints: Endpoints,
    stop: StopRequest | None = None,
    make_gate: GateFactory = CommandGate,
    ready: Callable[[], None] = lambda: None,
) -> str:
    """Serve a robot until it is asked to stop: sense, publish, guard, command.

    Offsets stored beside the robot file are taken off its ankle sensors' readings. It
    begins in HOLD at the measured posture. Commands go through the same gate as in
    the simulator. When it ends, also by an error of the adapter, the servos hold what
    they were told last, and the commander is told why.

    Args:
        adapter: the vendor's robot; a :class:`PacingAdapter` sets the pace itself.
        robot: what its files say; also the control rate.
        endpoints: where to listen.
        stop: ends it, besides signals.
        make_gate: the guard.
        ready: called once the bus is open.

    Returns:
        Who or what asked it to stop.

    Raises:
        EndpointError: cannot listen there.
        FileFormatError: the file with the offsets is malformed.
        RobotFileError: what the adapter reads at first is no posture of this robot;
            nothing has been written to it.
    """
    tare = load_tare(robot.path)
    stop = stop or StopRequest()
    first = adapter.read(0, time.monotonic_ns())
    gate = make_gate(robot, _first_posture(robot, first.q))
    begin_s = time.monotonic()
    with (
        stop.on_signals(),
        RobotServer(robot, gate, endpoints=endpoints, stop=stop) as server,
        _telling_the_end(server, gate, stop, begin_s=begin_s),
    ):
        pacer = Pacer(robot.period_s, lateness=TimingLog())
        latency = CommandLatency()
        paced = adapter if isinstance(adapter, PacingAdapter) else None
        wait = pacer.wait if paced is None else paced.wait
        ready()
        missing: tuple[str, ...] = ()
        tick, posture = 0, gate.posture
        with quiet_interpreter():
            while not stop.is_set:
                now_s = time.monotonic() - begin_s
                gate.begin_tick(now_s=now_s, tick=tick)
                server.serve_requests(now_s=now_s)
                snapshot = tare.taken_off(adapter.read(tick, time.monotonic_ns()))
                if paced is not None:
                    missing = paced.missing
                stamp_ns = snapshot.stamp_ns
                latency.sensed(tick, stamp_ns=stamp_ns)
                server.publish_sensors(snapshot, stamp_ns=stamp_ns, missing=missing)
                result = server.take_newest(now_s=now_s)
                if result is not None:
                    posture = result.posture
                    latency.taken(result.answers, acts_at=tick)
                adapter.write(posture)
                latency.applied(tick)
                server.publish_status(now_s=now_s)
                tick += 1
                wait()
        times = latency.log.distribution()
        _LOG.info(
            "%d ticks, %d skipped; sensors to servos %.3f, p99 %.3f, max %.3f ms",
            *(tick, pacer.skipped, times.median, times.p99, times.max),
        )
    return stop.cause


@contextmanager
def _telling_the_end(
    server: RobotServer, gate: CommandGate, stop: StopRequest, *, begin_s: float
) -> Iterator[None]:
    """Give the lease back at the end, and say why it came, errors included."""
    try:
        yield
    except Exception as error:  # of any vendor's library: told, and raised again
        stop.set(f"the driver failed: {error!r}")
        raise
    finally:
        commander = gate.modes.lease.holder
        gate.modes.finish(ModeCause.STOPPED, stop.cause)
        server.publish_status(now_s=time.monotonic() - begin_s, at_once=True)
        server.see_off(commander)


def _first_posture(robot: Robot, q: Array) -> Array:
    """The posture to hold from the first reading on.

    Numbers in degrees or in another order are no posture, and to hold the nearest one
    would move the robot.

    Raises:
        RobotFileError: not a number per joint, or one far out of its range.
    """
    hint = "are they in rad, and in the order of the robot file?"
    if q.shape != (robot.n_a,):
        raise RobotFileError(
            f"the driver reads {q.size} joint positions, expected {robot.n_a}; {hint}"
        )
    held: Array = np.clip(q, robot.lower, robot.upper)
    is_near = np.abs(q - held) <= robot.file.gate.first_command_tolerance_rad
    if not is_near.all():
        worst = int(np.argmin(is_near))
        raise RobotFileError(
            f"the driver reads {q[worst]:g} rad for {robot.joint_names[worst]}, whose "
            f"range is [{robot.lower[worst]:g}, {robot.upper[worst]:g}]; {hint}"
        )
    return held
