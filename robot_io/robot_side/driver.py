"""The loop of a hardware driver, between a vendor's SDK and the bus.

Each tick: read -> publish sensors -> gate the newest command -> write to the servos.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.realtime import (
    CommandLatency,
    Pacer,
    StopRequest,
    TimingLog,
    quiet_interpreter,
)
from surefoot.robot_io.robot import Robot, load_robot, load_tare
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.server import RobotServer
from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout
from surefoot.schemas.arrays import Array
from surefoot.schemas.endpoints import Endpoints, load_endpoints
from surefoot.schemas.reasons import ModeCause

_LOG = logging.getLogger(__name__)


class VendorAdapter(Protocol):
    """Interface to a vendor's robot, in our joint order, units, signs and frames.

    The loop alone calls both methods, once per tick. They must not block for longer
    than a fraction of a tick. An adapter may have either of two more members:

    - ``missing: tuple[str, ...]``, after each ``read``: channels without a recent value
      in it. They are not sent, so that the stabilizer notices.
    - ``wait() -> None`` returns at the robot's next reading, or after a long silence.
      It paces the loop of a robot that sends readings by itself.
    """

    def read(self, tick: int, stamp_ns: int) -> Snapshot:
        """Take a reading of all sensors.

        Args:
            tick: number of the robot's period; passed on in the reading.
            stamp_ns: monotonic clock now; passed on, or replaced by a better stamp from
                one clock for all sensors [ns].
        """
        ...

    def write(self, q_command: Array) -> None:
        """Let the servos follow a posture.

        Args:
            q_command: (n_a,) positions passed by the gate, also in HOLD [rad].
        """
        ...


class GateFactory(Protocol):
    """Makes the command gate in front of the servos."""

    def __call__(self, robot: Robot, posture: Array) -> CommandGate:
        """Return a gate that starts in HOLD at a posture (n_a,) [rad]."""
        ...


def drive(
    adapter: VendorAdapter,
    robot: str | Path | Robot,
    endpoints: str | Path | Endpoints | None = None,
    *,
    stop: StopRequest | None = None,
    make_gate: GateFactory = CommandGate,
    ready: Callable[[], None] = lambda: None,
) -> str:
    """Serve a robot until asked to stop: sense, publish, guard, command.

    The offsets stored beside the robot file are subtracted from the readings of its
    ankle sensors. The robot starts in HOLD at the measured posture. Commands go through
    the same gate as in the simulator. At the end, even by an error of the adapter, the
    servos hold their last command, and the commander is told the reason.

    Args:
        adapter: the vendor's robot; one with ``wait`` sets the pace itself.
        robot: shipped name, path of a robot file, or a loaded robot; sets the control
            rate.
        endpoints: where to listen: an endpoint file, or None for loopback.
        stop: ends the loop, besides signals.
        make_gate: makes the command gate.
        ready: called once the bus is open.

    Returns:
        Who or what asked it to stop.

    Raises:
        EndpointError: Zenoh cannot listen there.
        FileFormatError: the endpoint file or that with the offsets is malformed.
        RobotFileError: no such robot; or the adapter's first reading is no reading of
            this robot's sensors, or no posture of it, and nothing has been written to
            the adapter.
    """
    if not isinstance(robot, Robot):
        robot = load_robot(robot)
    if endpoints is None:
        endpoints = Endpoints()
    elif not isinstance(endpoints, Endpoints):
        endpoints = load_endpoints(Path(endpoints))
    tare = load_tare(robot.path)
    stop = stop or StopRequest()
    first = adapter.read(0, time.monotonic_ns())
    _check_fields(robot, first)
    gate = make_gate(robot, _first_posture(robot, first.q))
    begin_s = time.monotonic()
    with (
        stop.on_signals(),
        RobotServer(robot, gate, endpoints=endpoints, stop=stop) as server,
        _telling_the_end(server, gate, stop, begin_s=begin_s),
    ):
        pacer = Pacer(robot.period_s, lateness=TimingLog())
        latency = CommandLatency()
        wait: Callable[[], None] = getattr(adapter, "wait", pacer.wait)
        ready()
        if tare.is_zero and robot.file.virtual_ft is None:
            _LOG.warning(
                "%s: no offsets of its ankle sensors are stored; with narrow soles a "
                "few per cent of the weight can fell it: surefoot tare",
                robot.file.name,
            )
        tick, posture = 0, gate.posture
        with quiet_interpreter():
            while not stop.is_set:
                now_s = time.monotonic() - begin_s
                gate.begin_tick(now_s=now_s, tick=tick)
                server.serve_requests(now_s=now_s)
                snapshot = tare.taken_off(adapter.read(tick, time.monotonic_ns()))
                missing: tuple[str, ...] = getattr(adapter, "missing", ())
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
    """Give the lease back at the end and report the reason, errors included."""
    try:
        yield
    except Exception as error:  # from any vendor's library: reported and raised again
        stop.set(f"the driver failed: {error!r}")
        raise
    finally:
        commander = gate.modes.lease.holder
        gate.modes.finish(ModeCause.STOPPED, stop.cause)
        server.see_off(commander, now_s=time.monotonic() - begin_s)


def _check_fields(robot: Robot, first: Snapshot) -> None:
    """Check the kind and shape of all readings, which later ticks trust.

    Raises:
        RobotFileError: one is no array, or has another shape.
    """
    for field, place in SnapshotLayout(robot.n_a).places.items():
        value, expected = getattr(first, field, None), (place.stop - place.start,)
        got = repr(value)
        if isinstance(value, np.ndarray):
            if value.shape == expected and value.dtype.kind in "fiu":
                continue
            got = f"an array {value.shape} of {value.dtype}"
        raise RobotFileError(
            f"the driver's first reading: {field}: got {got}, expected an array "
            f"{expected} of floats; mend the adapter's read(), see Snapshot"
        )


def _first_posture(robot: Robot, q: Array) -> Array:
    """Return the posture to hold from the first reading on, (n_a,) [rad].

    Numbers in degrees or in another order are no posture; holding the nearest one would
    move the robot.

    Raises:
        RobotFileError: a number is far outside its joint's range.
    """
    held: Array = np.clip(q, robot.lower, robot.upper)
    is_near = np.abs(q - held) <= robot.file.gate.first_command_tolerance_rad
    if not is_near.all():
        worst = int(np.argmin(is_near))
        raise RobotFileError(
            f"the driver reads {q[worst]:g} rad for {robot.joint_names[worst]}, whose "
            f"range is [{robot.lower[worst]:g}, {robot.upper[worst]:g}]; are they in "
            "rad, and in the order of the robot file?"
        )
    return held
