"""Bus times for :mod:`benchmarks.peers`: ours, bare Zenoh and a TCP socket."""

from __future__ import annotations

import json
import multiprocessing
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import zenoh

from surefoot.robot_io.bus.bus import loopback_endpoints
from surefoot.robot_io.client_side.client import RobotClient
from surefoot.robot_io.realtime import StopRequest, quiet_interpreter
from surefoot.robot_io.robot import Robot, load_robot
from surefoot.robot_io.robot_side.gate import CommandGate
from surefoot.robot_io.robot_side.mode_machine import CommandResult
from surefoot.robot_io.robot_side.server import NoAnswer, RobotServer
from surefoot.robot_io.snapshot import Snapshot, SnapshotLayout, sensor_messages
from surefoot.schemas.codec import decode, encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import SCHEMA_VERSION, JointCommand
from surefoot.schemas.reasons import ModeCause

SPAWN = multiprocessing.get_context("spawn")
US_PER_NS = 1e-3
START_TIMEOUT_S = 20.0
ANSWER_TIMEOUT_S = 5.0
WARM_UP_TICKS = 200
MESSAGE_BYTES = 1200
"""Approximate size of a tick's sensor messages."""
ANSWER_BYTES = 400
"""Approximate size of a joint command."""
BEYOND_PACKING = "bus round trip less packing"
FOUR_MESSAGES = "bare Zenoh, four messages"


def bus_times(robot: Robot, ticks: int) -> dict[str, float]:
    """Return wall-clock round trips of the bus, bare Zenoh and a TCP socket [us].

    Bare Zenoh carries the sensors of a tick in one message, and in four like the bus;
    nothing is packed, checked or gated in either. The bus is also given without the
    time to pack and unpack the five messages of a tick.
    """
    ours, packing = _our_trips(robot, ticks), _packing(robot, ticks)
    times = {"bus round trip": ours, BEYOND_PACKING: ours - packing}
    sensors = sensor_messages(_snapshot(robot, 1), stamp_ns=0)
    for name, echo, ask, sizes in (
        ("bare Zenoh", _zenoh_echo, _zenoh_ask, [MESSAGE_BYTES]),
        (FOUR_MESSAGES, _zenoh_echo, _zenoh_ask, [len(encode(m)) for m in sensors]),
        ("raw sockets", _socket_echo, _socket_ask, [MESSAGE_BYTES]),
    ):
        port = _free_port()
        peer = SPAWN.Process(target=echo, args=(port, len(sizes)), daemon=True)
        peer.start()
        times[name] = ask(port, ticks, sizes)
        peer.join(START_TIMEOUT_S)
    return times


def _our_trips(robot: Robot, ticks: int) -> float:
    """Time the bus: a process sends four sensor messages, one answers with a command.

    Nothing is computed in between: the time is that of bus, codec, gate and wake-ups.
    """
    endpoints = loopback_endpoints()
    peer = SPAWN.Process(target=_answer_ticks, args=(str(robot.path), endpoints))
    peer.start()
    gate = CommandGate(robot, robot.nominal)
    snapshots = iter([_snapshot(robot, tick) for tick in range(WARM_UP_TICKS + ticks)])
    try:
        with RobotServer(
            robot, gate, endpoints=endpoints, stop=StopRequest()
        ) as server:
            if not server.wait_until_active(timeout_s=START_TIMEOUT_S):
                raise SystemExit("the answering process did not come up")

            def trip() -> None:
                _one_tick(server, gate, next(snapshots))

            with quiet_interpreter():
                _round_trips(WARM_UP_TICKS, trip)
                median = _round_trips(ticks, trip)
            gate.modes.finish(ModeCause.RUN_OVER, "measured")
            server.see_off("", now_s=0.0)
            return median
    finally:
        peer.join(START_TIMEOUT_S)


def _one_tick(server: RobotServer, gate: CommandGate, snapshot: Snapshot) -> None:
    tick, now_s = snapshot.tick, snapshot.tick * 1e-3
    gate.begin_tick(now_s=now_s)
    server.publish_sensors(snapshot, stamp_ns=time.monotonic_ns())
    deadline = time.monotonic() + ANSWER_TIMEOUT_S
    answer: CommandResult | NoAnswer = NoAnswer.YET
    while answer is NoAnswer.YET and time.monotonic() < deadline:
        answer = server.answer(tick, now_s=now_s, deadline=deadline)
        server.serve_requests(now_s=now_s)
    if not isinstance(answer, CommandResult) or not answer.accepted:
        raise SystemExit(f"tick {tick}: {answer}, {gate.modes.notice}")
    server.publish_status(now_s=now_s)


def _answer_ticks(robot_path: str, endpoints: Endpoints) -> None:
    """Run the other process: answer every tick with the measured joint positions."""
    with RobotClient(
        load_robot(robot_path),
        endpoints=endpoints,
        identity="bench",
        in_order=True,
        stop=StopRequest(),
    ) as client:
        client.connect(timeout_s=START_TIMEOUT_S)
        client.take_lease()
        client.enable()
        with quiet_interpreter():
            while reading := client.wait_snapshot(timeout_s=ANSWER_TIMEOUT_S):
                client.reference()
                client.send(reading.snapshot.q, tick=reading.snapshot.tick)
                client.status()


def _snapshot(robot: Robot, tick: int) -> Snapshot:
    """A snapshot with numbers of full length, as of a moving robot."""
    layout = SnapshotLayout(robot.n_a)
    numbers = np.sin(1e-3 * tick + np.arange(layout.size))
    q = layout.places["q"]
    numbers[q] = robot.nominal + 1e-3 * numbers[q]
    return layout.view(tick, 0, numbers)


def _packing(robot: Robot, ticks: int) -> float:
    """Time packing and unpacking all five messages of a tick in one process."""
    now_ns = time.monotonic_ns()
    command = JointCommand(
        schema=SCHEMA_VERSION,
        tick=1,
        stamp_ns=now_ns,
        q=robot.nominal.tolist(),
        commander="bench",
        sequence=1,
    )
    sent = [*sensor_messages(_snapshot(robot, 1), stamp_ns=now_ns), command]

    def pack_and_unpack() -> None:
        for message in sent:
            decode(encode(message), type(message), joint_count=robot.n_a)

    return _round_trips(ticks, pack_and_unpack)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


def _round_trips(ticks: int, trip: Callable[[], None]) -> float:
    times = []
    for _ in range(ticks):
        begin = time.perf_counter_ns()
        trip()
        times.append(time.perf_counter_ns() - begin)
    return float(np.median(times)) * US_PER_NS


def _socket_echo(port: int, count: int) -> None:
    with socket.create_server(("127.0.0.1", port)) as server:
        link, _ = server.accept()
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with link:
            while data := link.recv(MESSAGE_BYTES, socket.MSG_WAITALL):
                link.sendall(data[:ANSWER_BYTES])


def _socket_ask(port: int, ticks: int, sizes: Sequence[int]) -> float:
    end = time.monotonic() + START_TIMEOUT_S
    while True:
        try:
            link = socket.create_connection(("127.0.0.1", port))
            break
        except ConnectionRefusedError:
            if time.monotonic() > end:
                raise
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    [data] = map(bytes, sizes)
    with link:

        def trip() -> None:
            link.sendall(data)
            link.recv(ANSWER_BYTES, socket.MSG_WAITALL)

        return _round_trips(ticks, trip)


def _zenoh(port: int, side: str) -> Any:
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5(f"{side}/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    return zenoh.open(config)


def _zenoh_echo(port: int, count: int) -> None:
    with _zenoh(port, "connect") as session:
        asked = [
            session.declare_subscriber(f"ask/{i}", zenoh.handlers.FifoChannel(4))
            for i in range(count)
        ]
        answer = session.declare_publisher("answer", express=True)
        answer.put(b"up")
        while all([len(channel.recv().payload) > 0 for channel in asked]):
            answer.put(bytes(ANSWER_BYTES))


def _zenoh_ask(port: int, ticks: int, sizes: Sequence[int]) -> float:
    with _zenoh(port, "listen") as session:
        answers = session.declare_subscriber("answer", zenoh.handlers.FifoChannel(4))
        last = len(sizes) - 1  # flushes those before it, like the bus's last one
        ask = [
            session.declare_publisher(f"ask/{i}", express=i == last)
            for i in range(len(sizes))
        ]
        answers.recv()
        payloads = [bytes(size) for size in sizes]

        def trip() -> None:
            for publisher, payload in zip(ask, payloads, strict=True):
                publisher.put(payload)
            answers.recv()

        median = _round_trips(ticks, trip)
        for publisher in ask:
            publisher.put(b"")
        return median
