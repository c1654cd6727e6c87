"""The bus of :mod:`benchmarks.peers`: ours, bare Zenoh and a TCP socket."""

from __future__ import annotations

import json
import multiprocessing
import socket
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import zenoh

from benchmarks import bench_bus
from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import sensor_messages
from surefoot.schemas.codec import encode

US_PER_NS = 1e-3
MESSAGE_BYTES = 1200
"""About what the sensors of a tick take on the bus."""
ANSWER_BYTES = 400
"""About what a joint command takes."""
BEYOND_PACKING = "bus round trip less packing"
FOUR_MESSAGES = "bare Zenoh, four messages"


def bus_times(robot: Robot, ticks: int) -> dict[str, float]:
    """Return wall-clock round trips of the bus, bare Zenoh and a TCP socket [us].

    Bare Zenoh carries the sensors of a tick in one message, and in four as the bus
    does: nothing is packed, checked or gated in either. The bus less its packing is
    given, too: less what it takes to pack and unpack the five messages of a tick.
    """
    load = bench_bus.Load(0.0, 0.0)
    ours = bench_bus._measure(robot, ticks, 0, load).median * 1e3
    spawn = multiprocessing.get_context("spawn")
    packing = bench_bus._measure_codec(robot, ticks).median * 1e3
    times = {"bus round trip": ours, BEYOND_PACKING: ours - packing}
    sensors = sensor_messages(bench_bus._snapshot(robot, 1), stamp_ns=0)
    for name, echo, ask, sizes in (
        ("bare Zenoh", _zenoh_echo, _zenoh_ask, [MESSAGE_BYTES]),
        (FOUR_MESSAGES, _zenoh_echo, _zenoh_ask, [len(encode(m)) for m in sensors]),
        ("raw sockets", _socket_echo, _socket_ask, [MESSAGE_BYTES]),
    ):
        port = bench_bus._free_port()
        peer = spawn.Process(target=echo, args=(port, len(sizes)), daemon=True)
        peer.start()
        times[name] = ask(port, ticks, sizes)
        peer.join(bench_bus.START_TIMEOUT_S)
    return times


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
    end = time.monotonic() + bench_bus.START_TIMEOUT_S
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
        last = len(sizes) - 1  # sends what waits before it, as the bus's last one does
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
