"""The bus of :mod:`benchmarks.peers`: ours, bare Zenoh and a TCP socket."""

from __future__ import annotations

import json
import multiprocessing
import socket
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import zenoh

from benchmarks import bench_bus

US_PER_NS = 1e-3
MESSAGE_BYTES = 1200
"""About what the sensors of a tick take on the bus."""


def bus_times(robot: Any, ticks: int) -> dict[str, float]:
    """Return wall-clock round trips of the bus, bare Zenoh and a TCP socket [us]."""
    load = bench_bus.Load(0.0, 0.0)
    ours = bench_bus._measure(robot, ticks, 0, load).median * 1e3
    spawn = multiprocessing.get_context("spawn")
    times = {"bus round trip": ours}
    for name, echo, ask in (
        ("bare Zenoh", _zenoh_echo, _zenoh_ask),
        ("raw sockets", _socket_echo, _socket_ask),
    ):
        port = bench_bus._free_port()
        peer = spawn.Process(target=echo, args=(port,), daemon=True)
        peer.start()
        times[name] = ask(port, ticks)
        peer.join(bench_bus.START_TIMEOUT_S)
    return times


def _round_trips(ticks: int, trip: Callable[[], object]) -> float:
    times = []
    for _ in range(ticks):
        begin = time.perf_counter_ns()
        trip()
        times.append(time.perf_counter_ns() - begin)
    return float(np.median(times)) * US_PER_NS


def _socket_echo(port: int) -> None:
    with socket.create_server(("127.0.0.1", port)) as server:
        link, _ = server.accept()
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with link:
            while data := link.recv(MESSAGE_BYTES, socket.MSG_WAITALL):
                link.sendall(data[:400])


def _socket_ask(port: int, ticks: int) -> float:
    end = time.monotonic() + bench_bus.START_TIMEOUT_S
    while True:
        try:
            link = socket.create_connection(("127.0.0.1", port))
            break
        except ConnectionRefusedError:
            if time.monotonic() > end:
                raise
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    data = bytes(MESSAGE_BYTES)
    with link:
        return _round_trips(
            ticks, lambda: (link.sendall(data), link.recv(400, socket.MSG_WAITALL))
        )


def _zenoh(port: int, side: str) -> Any:
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5(f"{side}/endpoints", json.dumps([f"tcp/127.0.0.1:{port}"]))
    return zenoh.open(config)


def _zenoh_echo(port: int) -> None:
    with _zenoh(port, "connect") as session:
        asked = session.declare_subscriber("ask", zenoh.handlers.FifoChannel(4))
        answer = session.declare_publisher("answer", express=True)
        answer.put(b"up")
        for sample in asked:
            if len(sample.payload) < MESSAGE_BYTES:
                return
            answer.put(bytes(400))


def _zenoh_ask(port: int, ticks: int) -> float:
    with _zenoh(port, "listen") as session:
        answers = session.declare_subscriber("answer", zenoh.handlers.FifoChannel(4))
        ask = session.declare_publisher("ask", express=True)
        answers.recv()
        data = bytes(MESSAGE_BYTES)
        median = _round_trips(ticks, lambda: (ask.put(data), answers.recv()))
        ask.put(b"end")
        return median
