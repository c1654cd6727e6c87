"""The controller's side of the bus: receives snapshots and sends joint commands."""

from __future__ import annotations

import contextlib
import os
import time
from contextlib import ExitStack
from typing import Any, Self

import numpy as np

from surefoot.robot_io.bus.bus import Bus, dial
from surefoot.robot_io.bus.channel import Inbox, Latest
from surefoot.robot_io.client_side.assembler import (
    SensorReader,
    SnapshotAssembler,
    SnapshotReading,
)
from surefoot.robot_io.client_side.requests import (
    Asked,
    ServiceCaller,
    StabilizerServices,
)
from surefoot.robot_io.client_side.robot_watch import RobotWatch
from surefoot.robot_io.errors import RobotIoError
from surefoot.robot_io.realtime import Pace, StopRequest
from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.codec import encode
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.messages import (
    SCHEMA_VERSION,
    JointCommand,
    ModeRequest,
    Reference,
    RobotStatus,
    ServiceReply,
    SettingsChange,
    StabilizerStatus,
)
from surefoot.schemas.sensors import SENSORS, Sensor
from surefoot.schemas.topics import ALIVE_STABILIZER
from surefoot.schemas.walk_plan import WalkPlan, WalkStatus, parts_of

SENSOR_MESSAGES_KEPT = 64
REQUEST_TIMEOUT_S = 5.0
RELEASE_TIMEOUT_S = 1.0
"""Short, because the lease of a robot that is gone expires by itself [s]."""
PATIENCE_S = 0.005
"""Longest wait for a missing sensor of a tick [s]."""
LOCKSTEP_PATIENCE_S = 0.5
"""The same in lockstep, where the robot's time stands still meanwhile [s].

It is long, so that no pause of a busy machine changes the run. Twice this time is less
than the robot waits for an answer."""


_give_way = getattr(os, "sched_yield", lambda: None)
"""Lets Zenoh's sender run; does nothing on systems without ``sched_yield``."""


class RobotClient:
    """Reads a robot's sensors and commands its joints.

    A context manager, used by one thread::

        with RobotClient(robot, endpoints=endpoints, identity="me", ...) as client:
            client.connect(timeout_s=10.0)
            client.take_lease()
            q = client.enable()
            while (reading := client.wait_snapshot(timeout_s=0.1)) is not None:
                client.send(q, tick=reading.snapshot.tick)

    Leaving the context gives the lease back.
    """

    _bus: Bus

    def __init__(
        self,
        robot: Robot,
        *,
        endpoints: Endpoints,
        identity: str,
        in_order: bool,
        stop: StopRequest,
    ) -> None:
        """Prepare; :meth:`connect` dials.

        Args:
            robot: has the names of keys and joints.
            endpoints: where to dial.
            identity: name of this commander; one word, unique on the bus.
            in_order: deliver every tick once, none skipped (lockstep); otherwise
                the newest.
            stop: ends the waits.
        """
        self.identity = identity
        self._robot = robot
        self._endpoints = endpoints
        self._in_order = in_order
        self._stop = stop
        self._stack = ExitStack()
        self._watch = RobotWatch(robot, on_change=self._on_change)
        self._sequence = 0
        self._has_lease = False

    def __enter__(self) -> Self:
        """Do nothing yet; see :meth:`connect`."""
        return self

    def __exit__(self, *why: object) -> None:
        """Give the lease back and close the bus."""
        try:
            if self._commands_still():
                with contextlib.suppress(RobotIoError):  # it may end this very moment
                    self.release()
        finally:
            self._stack.close()

    def connect(self, *, timeout_s: float) -> bool:
        """Dial, and wait until the robot is ready.

        Returns:
            Whether it is ready; False when the wait was stopped.

        Raises:
            EndpointError: a locator is malformed.
            RobotUnreachableError: no robot was ready in time.
            RobotMismatchError: the robot has another description, or there are two
                robots.
        """
        end = time.monotonic() + timeout_s
        with ExitStack() as stack:
            bus = dial(
                stack,
                self._endpoints,
                namespace=self._robot.file.namespace,
                timeout_s=timeout_s,
                pace=Pace.LOCKSTEP if self._in_order else Pace.REALTIME,
                stop=self._stop,
            )
            if bus is None:
                return False
            self._bus = bus
            self._declare()
            self._stack = stack.pop_all()
        self._stop.waking(bus.waker.interrupt)
        found = self._watch.find_within(
            end, endpoints=self._endpoints, timeout_s=timeout_s, stop=self._stop
        )
        return found is not None

    @property
    def robot_is_here(self) -> bool:
        """Whether the robot's process is alive, according to the bus.

        Raises:
            SecondRobotError: a second robot has come to its namespace and stays.
        """
        if not self._watch.is_same:
            return False
        self._watch.check()
        return True

    def take_lease(self) -> ServiceReply:
        """Become the robot's commander.

        Raises:
            RequestRefusedError: another commander has the lease; the message names it.
            RobotMismatchError: another robot answers.
            RobotUnreachableError: no answer.
        """
        reply = self._ask_lease("take")
        self._has_lease = True
        return reply

    def release(self) -> ServiceReply:
        """Give the lease back; the robot holds its posture.

        Raises:
            RequestRefusedError: the lease was not ours.
            RobotUnreachableError: no answer.
        """
        self._has_lease = False
        return self._ask_lease("release", timeout_s=RELEASE_TIMEOUT_S)

    def enable(self) -> Array:
        """Let the robot follow commands from now on.

        Earlier snapshots are dropped; the next one is the first to answer.

        Returns:
            (n_a,) posture that the robot holds; the first command must start there
            [rad].

        Raises:
            RequestRefusedError: the lease is not ours, or the robot is in fault or off.
            RobotUnreachableError: no answer.
        """
        self._assembler.restart()
        self._status.forget()
        return np.array(self.request_mode("enable").q_command)

    def request_mode(self, action: str) -> ServiceReply:
        """Ask for a mode: enable, hold, disable or reset.

        Raises:
            RequestRefusedError: the robot refuses; the message has its reason.
            RobotUnreachableError: no answer.
        """
        request = ModeRequest(
            schema=SCHEMA_VERSION, action=action, commander=self.identity
        )
        return self._services.ask(self._robot.keys["mode"], request)

    def wait_snapshot(self, *, timeout_s: float) -> SnapshotReading | None:
        """Wait for the next snapshot: in lockstep the next tick, otherwise the newest.

        Returns:
            The snapshot; None if time is up, the robot is gone or the wait was stopped.
        """
        return self._assembler.wait(time.monotonic() + timeout_s)

    def missing_sensors(self) -> tuple[str, ...]:
        """Return the channels without any message since enabling."""
        return self._assembler.missing()

    def send(self, q_command: Array, *, tick: int) -> None:
        """Command the joints.

        Args:
            q_command: (n_a,) joint positions in bus order [rad].
            tick: the tick that this command answers.
        """
        command = JointCommand(
            schema=SCHEMA_VERSION,
            tick=tick,
            stamp_ns=time.monotonic_ns(),
            q=q_command.tolist(),
            commander=self.identity,
            sequence=self._sequence,
        )
        self._sequence += 1
        self._command.put(encode(command))
        _give_way()  # to Zenoh's sender, if it waits for this processor

    def status(self) -> RobotStatus | None:
        """Return the robot's newest status; None before the first."""
        return self._status.poll()

    def reference(self) -> Reference | None:
        """Return the planner's newest reference; None before the first."""
        return self._reference.poll()

    def plan(self) -> WalkPlan | None:
        """Return the planner's newest steps; None before the first."""
        return self._plan.poll()

    def publish_walk(self, status: WalkStatus) -> None:
        """Publish the state of the walk."""
        self._own_walk.put(encode(status))

    def publish_taken(self, plan: WalkPlan) -> None:
        """Publish steps that the controller has taken over; a long plan in parts."""
        for part in parts_of(plan, most_bytes=self._endpoints.max_bytes):
            self._own_taken.put(encode(part))

    def publish_status(self, status: StabilizerStatus) -> None:
        """Publish the controller's status."""
        self._own_status.put(encode(status))

    def publish_change(self, change: SettingsChange) -> None:
        """Publish a change of settings."""
        self._own_changes.put(encode(change))

    def next_request(self) -> Asked | None:
        """Return the next request to the stabilizer, to be answered, or None."""
        return self._requests.next()

    def _commands_still(self) -> bool:
        """Return whether there is a lease to give back; a robot in OFF has freed it.

        In an urgent end the lease is not given back; the robot notices the loss.
        """
        if not self._has_lease or not self._watch.is_same or self._stop.is_urgent:
            return False
        status = self._status.poll()
        return status is None or status.commander == self.identity

    def _declare(self) -> None:
        """Declare everything on the bus: the token second to last, the watch last."""
        bus, keys, n_a = self._bus, self._robot.keys, self._robot.n_a
        self._assembler = SnapshotAssembler(
            [self._reader(entry) for entry in SENSORS],
            joint_count=n_a,
            in_order=self._in_order,
        )
        self._status = Latest(
            bus.channel(keys["status"], depth=1), RobotStatus, joint_count=n_a
        )
        self._reference = Latest(
            bus.channel(keys["reference"], depth=1), Reference, joint_count=n_a
        )
        self._plan = Latest(bus.channel(keys["walk"], depth=1), WalkPlan)
        self._command = bus.publisher(keys["joint_command"], urgent=True)
        self._own_walk = bus.publisher(keys["walk_status"], urgent=False)
        self._own_taken = bus.publisher(keys["walk_taken"], urgent=False)
        self._own_status = bus.publisher(keys["stabilizer"], urgent=False)
        self._own_changes = bus.publisher(keys["settings_change"], urgent=False)
        self._requests = StabilizerServices(bus, self._robot)
        self._services = ServiceCaller(
            bus.session,
            joint_count=n_a,
            timeout_s=REQUEST_TIMEOUT_S,
            robot_is_here=lambda: self._watch.is_same,
            check=self._watch.check_reply,
        )
        bus.announce(f"{ALIVE_STABILIZER}/{self.identity}")
        self._watch.follow(bus)

    def _ask_lease(self, action: str, timeout_s: float | None = None) -> ServiceReply:
        request = self._watch.lease_request(action, self.identity)
        return self._services.ask(
            self._robot.keys["lease"], request, timeout_s=timeout_s
        )

    def _reader(self, entry: Sensor) -> SensorReader[Any]:
        key, n_a = self._robot.keys[entry.name], self._robot.n_a
        channel = self._bus.channel(key, depth=SENSOR_MESSAGES_KEPT)
        return SensorReader(
            entry.name,
            Inbox(channel, entry.message, joint_count=n_a),
            patience_s=LOCKSTEP_PATIENCE_S if self._in_order else PATIENCE_S,
        )

    def _on_change(self) -> None:
        if self._watch.found is not None and not self._watch.is_same:
            self._bus.waker.interrupt()  # nothing more comes from it
