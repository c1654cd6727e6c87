"""Peers that stop for longer than the lease keep nobody else from the robot."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

from tests.command import environment
from tests.support import PATIENCE_S, free_port

pytestmark = pytest.mark.process

FROZEN = 3
MESSAGES, MOST_SILENT = 300, 3000
BUS = """
import sys, time
from surefoot.robot_io.bus.bus import Bus
from surefoot.robot_io.bus.session import Role
from surefoot.schemas.endpoints import Endpoints
place = ["tcp/127.0.0.1:{port}"]
endpoints = Endpoints(listen=place, connect=place, lease_ms=100)

def say(word):
    print(word, flush=True)
"""
ROBOT = """
gone = []
with Bus(endpoints, Role.ROBOT, namespace="walker") as bus:
    channel = bus.channel("cmd", depth=64)
    publisher = bus.publisher("state", urgent=True, flush=True)
    bus.watch_presence("alive/*", lambda key, is_there: is_there or gone.append(key))
    say("ready")
    left, silent, longest = {messages}, 0, 0
    while left:
        publisher.put(bytes(2000))
        time.sleep(0.001)
        came = channel.poll() is not None
        silent = 0 if came or not gone else silent + 1
        longest = max(longest, silent)
        left -= came and len(gone) >= {frozen}
    say(longest)
"""
CLIENT = """
with Bus(endpoints, Role.CLIENT, namespace="walker") as bus:
    publisher = bus.publisher("cmd", urgent=True, flush=True)
    say("ready")
    while True:
        publisher.put(bytes(600))
        time.sleep(0.001)
"""
ONLOOKER = """
with Bus(endpoints, Role.CLIENT, namespace="walker") as bus:
    bus.announce("alive/" + sys.argv[1])
    channels = [bus.channel(key, depth=4) for key in ("cmd", "state")]
    while channels[1].poll() is None:
        time.sleep(0.001)
    say("ready")
    time.sleep(3600)
"""


def test_the_robot_goes_on_hearing_its_client() -> None:
    values = {"port": free_port(), "messages": MESSAGES, "frozen": FROZEN}
    with ExitStack() as stack:

        def start(script: str, *words: str) -> subprocess.Popen[str]:
            process = subprocess.Popen(
                [sys.executable, "-c", (BUS + script).format(**values), *words],
                env=environment(),
                stdout=subprocess.PIPE,
                text=True,
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            return process

        robot = start(ROBOT)
        start(CLIENT)
        for onlooker in [start(ONLOOKER, str(name)) for name in range(FROZEN)]:
            onlooker.send_signal(signal.SIGSTOP)
        longest, _ = robot.communicate(timeout=PATIENCE_S)
        # In its own rounds, of a millisecond or more, as the client's are.
        assert int(longest) < MOST_SILENT
