"""What the bus costs: two processes in lockstep, with messages of real size.

Each tick the robot's process sends its four sensor messages and waits for the joint
command that answers them (``ping-pong``), or the one before (``pipelined``, as with a
command delay of one tick). Nothing is computed in between unless asked for, so what
is left is bus, codec, gate and wake-ups. Run it with nothing else on the machine::

    python -m benchmarks.bench_bus
    python -m benchmarks.bench_bus --plant-us 250 --controller-us 450
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import socket
import time
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np

from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.realtime import StopRequest, TimingLog, quiet_interpreter
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import CommandResult
from surefoot.robot_io.robot_side.server import NoAnswer, RobotServer
from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout, sensor_messages
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SCHEMA_VERSION, JointCommand
from surefoot.schemas.reasons import ModeCause
from surefoot.schemas.result import Distribution

NS_PER_US = 1e3
START_TIMEOUT_S = 20.0
ANSWER_TIMEOUT_S = 5.0
WARM_UP_TICKS = 200


class Load(NamedTuple):
    """What the two processes compute each tick, busily [us]."""

    plant_us: float
    controller_us: float


def main() -> None:
    """Measure and print a table."""
    options = _options()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    robot = load_robot(options.robot)
    load = Load(options.plant_us, options.controller_us)
    print(
        f"{robot.file.name}: {robot.n_a} joints, {options.ticks} ticks, plant "
        f"{load.plant_us:g} us, controller {load.controller_us:g} us"
    )
    print(f"{'':12}{'median':>9}{'p99':>9}{'max':>9}   [ms per tick]")
    for name, delay in (("ping-pong", 0), ("pipelined", 1)):
        _print(name, _measure(robot, options.ticks, delay, load))
    _print("codec", _measure_codec(robot, options.ticks))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--robot", default="walker")
    parser.add_argument("--ticks", type=int, default=5000)
    parser.add_argument("--plant-us", type=float, default=0.0)
    parser.add_argument("--controller-us", type=float, default=0.0)
    return parser.parse_args()


def _print(name: str, times: Distribution) -> None:
    print(f"{name:12}{times.median:9.3f}{times.p99:9.3f}{times.max:9.3f}")


def _measure(robot: Robot, ticks: int, delay: int, load: Load) -> Distribution:
    """Run both processes; time from one tick to the next in the robot's."""
    locator = f"tcp/127.0.0.1:{_free_port()}"
    endpoints = Endpoints(listen=[locator], connect=[locator])
    peer = multiprocessing.get_context("spawn").Process(
        target=_answer_ticks, args=(str(robot.path), endpoints, load.controller_us)
    )
    peer.start()
    try:
        return _run_robot(robot, endpoints, ticks=ticks, delay=delay, load=load)
    finally:
        peer.join(START_TIMEOUT_S)


def _run_robot(
    robot: Robot, endpoints: Endpoints, *, ticks: int, delay: int, load: Load
) -> Distribution:
    gate = CommandGate(robot, robot.nominal)
    times = TimingLog()
    snapshots = [_snapshot(robot, tick) for tick in range(WARM_UP_TICKS + ticks)]
    with RobotServer(robot, gate, endpoints=endpoints, stop=StopRequest()) as server:
        if not server.wait_until_active(now_s=0.0, timeout_s=START_TIMEOUT_S):
            raise SystemExit("the answering process did not come up")
        with quiet_interpreter():
            for snapshot in snapshots:
                begin = time.perf_counter_ns()
                _one_tick(server, gate, snapshot, delay)
                _compute(load.plant_us)
                if snapshot.tick >= WARM_UP_TICKS:
                    times.add(time.perf_counter_ns() - begin)
        gate.modes.finish(ModeCause.RUN_OVER, "measured")
        server.publish_status(now_s=0.0, at_once=True)
    return times.distribution()


def _one_tick(
    server: RobotServer, gate: CommandGate, snapshot: Snapshot, delay: int
) -> None:
    now_s = snapshot.tick * 1e-3
    gate.begin_tick(now_s=now_s)
    server.publish_sensors(snapshot, stamp_ns=time.monotonic_ns())
    due = snapshot.tick - delay
    if due >= 0:
        answer = _wait_answer(server, due, now_s)
        if not isinstance(answer, CommandResult) or not answer.accepted:
            raise SystemExit(f"tick {due}: {answer}, {gate.modes.notice}")
    server.serve_requests(now_s=now_s)
    server.publish_status(now_s=now_s)


def _wait_answer(
    server: RobotServer, tick: int, now_s: float
) -> CommandResult | NoAnswer:
    deadline = time.monotonic() + ANSWER_TIMEOUT_S
    answer: CommandResult | NoAnswer = NoAnswer.YET
    while answer is NoAnswer.YET and time.monotonic() < deadline:
        answer = server.answer(tick, now_s=now_s, deadline=deadline)
        server.serve_requests(now_s=now_s)
    return answer


def _answer_ticks(robot_path: str, endpoints: Endpoints, controller_us: float) -> None:
    """Run the other process: answer every tick with the measured joint positions."""
    robot = load_robot(robot_path)
    with RobotClient(
        robot, endpoints=endpoints, identity="bench", in_order=True, stop=StopRequest()
    ) as client:
        client.connect(timeout_s=START_TIMEOUT_S)
        client.take_lease()
        client.enable()
        with quiet_interpreter():
            while True:
                reading = client.wait_snapshot(timeout_s=ANSWER_TIMEOUT_S)
                if reading is None:
                    return
                client.reference()
                _compute(controller_us)
                client.send(reading.snapshot.q, tick=reading.snapshot.tick)
                client.status()


def _compute(busy_us: float) -> None:
    end = time.perf_counter_ns() + busy_us * NS_PER_US
    while time.perf_counter_ns() < end:
        pass


def _snapshot(robot: Robot, tick: int) -> Snapshot:
    """Full-length numbers, as a moving robot has."""
    layout = SnapshotLayout(robot.n_a)
    numbers = np.sin(1e-3 * tick + np.arange(layout.size))
    q = layout.places["q"]
    numbers[q] = robot.nominal + 1e-3 * numbers[q]
    return layout.view(tick, 0, numbers)


def _measure_codec(robot: Robot, ticks: int) -> Distribution:
    """Time packing and unpacking all five messages of a tick in one process."""
    sent: list[msgspec.Struct] = [
        *sensor_messages(_snapshot(robot, 1), stamp_ns=time.monotonic_ns()),
        JointCommand(
            schema=SCHEMA_VERSION,
            tick=1,
            stamp_ns=time.monotonic_ns(),
            q=robot.nominal.tolist(),
            commander="bench",
            sequence=1,
        ),
    ]

    def pack_and_unpack() -> None:
        for message in sent:
            decode(encode(message), type(message), joint_count=robot.n_a)

    return _time(ticks, pack_and_unpack)


def _time(count: int, run: Callable[[], None]) -> Distribution:
    times = TimingLog()
    for _ in range(count):
        begin = time.perf_counter_ns()
        run()
        times.add(time.perf_counter_ns() - begin)
    return times.distribution()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


if __name__ == "__main__":
    main()
