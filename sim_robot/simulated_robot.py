"""One run of the simulated robot: plant, command delay, metrics and record."""

from __future__ import annotations

import math

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.robot_side.mode_machine import DONE, Answer
from surefoot.robot_io.snapshot import Snapshot
from surefoot.robot_io.ticks.recorder import TickSink
from surefoot.schemas.arrays import MS_PER_S, Array
from surefoot.schemas.messages import PushEvent, PushRequest
from surefoot.schemas.reasons import ModeCause, RequestRefusal
from surefoot.schemas.result import COMMANDED, Distribution, ModeReport, PlantResult
from surefoot.schemas.scenario import Scenario
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.conventions import check_duration, whole_ticks
from surefoot.sim_robot.metrics import (
    Fall,
    PlantMetrics,
    RobotRecorder,
    RunDigest,
    WalkMetrics,
)
from surefoot.sim_robot.plant import CommandError, Plant
from surefoot.sim_robot.recorded import recorded_ground
from surefoot.sim_robot.sensor_lines import SensorFaults
from surefoot.sim_robot.state_view import PlantTruth

_RUN_LENGTH_TOLERANCE = 1e-9


class CommandDelay:
    """Holds commands back for a fixed number of ticks."""

    def __init__(self, ticks: int, *, posture: Array) -> None:
        """Start without commands.

        Args:
            ticks: delay d, zero or more.
            posture: (n_a,) posture until the first command acts [rad].
        """
        self.ticks = ticks
        self._answers: dict[int, Array] = {}
        self._acting = posture

    def needed(self, tick: int) -> int | None:
        """Return the tick whose answer acts in the step from ``tick`` on, or None."""
        return tick - self.ticks if tick >= self.ticks else None

    def put(self, q_command: Array, *, answers: int, now: int) -> None:
        """Take the answer to a tick.

        Args:
            q_command: (n_a,) commanded positions [rad]; copied.
            answers: the tick that the command answers.
            now: the present tick.

        Raises:
            CommandError: the answered tick is to come, or too long ago to act.
        """
        if not now - self.ticks <= answers <= now:
            raise CommandError(
                f"command: answers tick {answers} at tick {now}, expected one from "
                f"{max(0, now - self.ticks)} to {now} with a delay of {self.ticks} "
                "ticks; drop commands that come too late"
            )
        self._answers[answers] = q_command.copy()

    def take(self, now: int) -> Array:
        """Return the posture for the step from ``now`` on, (n_a,) [rad].

        If the answer that is due is missing, the posture before it goes on acting.
        """
        answer = self._answers.pop(now - self.ticks, None)
        if answer is not None:
            self._acting = answer
        return self._acting


class SimulatedRobot:
    """One run of a scenario, from tick 0 to its end or the fall.

    In lockstep and in one process, at each tick ``k``::

        snapshot = simulated.sense()        # send it to the controller
        due = simulated.commands_needed(k)  # wait for the answer to that tick
        if due is not None:
            simulated.apply(q_command, tick=due)
        simulated.step()

    The answer to tick k acts from tick k + d on, with d the scenario's command delay in
    ticks. Until the first answer acts, the servos hold the starting posture. With
    d >= 1 the plant can step tick k while the controller still answers tick k. The
    gate checks commands before they come here.
    """

    def __init__(
        self,
        robot: Robot,
        scenario: Scenario,
        *,
        seed: int,
        ticks: TickSink | None = None,
    ) -> None:
        """Build the plant; it stands at rest at tick 0.

        Raises:
            ScenarioError: the scenario does not fit the robot or its ticks.
        """
        period_s, delay_ms = robot.period_s, scenario.delay.command_ms
        check_duration(scenario.duration_s, period_s, what="duration_s")
        delay_ticks = 1
        if delay_ms is not None:
            delay_ticks = whole_ticks(
                delay_ms / MS_PER_S, period_s, what="delay.command_ms"
            )
        self.plant = Plant(robot, scenario, seed=seed)
        self._delay = CommandDelay(delay_ticks, posture=self.plant.posture)
        self._faults = SensorFaults(
            scenario.fault, joints=robot.joint_names, period_s=period_s
        )
        self._sensed: Snapshot | None = None
        self._period_s = period_s
        self._recorded_ground = recorded_ground(scenario)
        self._last_tick = math.ceil(
            scenario.duration_s / period_s - _RUN_LENGTH_TOLERANCE
        )
        self._fell_at_s: float | None = None
        self._fall: Fall | None = None
        self._asked_pushes: list[PushEvent] = []
        self._truth: PlantTruth | None = None
        self._metrics = PlantMetrics(
            self.plant.com_reference,
            weight=self.plant.world.weight,
            period_s=period_s,
        )
        self._walk = None if scenario.walk is None else WalkMetrics(period_s=period_s)
        self._digest = RunDigest(joints=robot.n_a)
        self._recorder: RobotRecorder | None = None
        if ticks is not None:
            self._recorder = RobotRecorder(
                ticks,
                joints=robot.joint_names,
                platforms=len(scenario.platform) + len(self.plant.world.seesaws),
                period_s=period_s,
            )

    @property
    def tick(self) -> int:
        """The present tick."""
        return self.plant.tick

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.plant.tick * self._period_s

    @property
    def held_posture(self) -> Array:
        """(n_a,) posture that the servos follow at tick 0 [rad]; not to be written."""
        return self.plant.posture

    @property
    def command_delay_ticks(self) -> int:
        """Ticks from a snapshot to the first step in which its answer acts."""
        return self._delay.ticks

    @property
    def fell(self) -> bool:
        """Whether the robot has fallen at any tick so far."""
        return self._fell_at_s is not None

    @property
    def finished(self) -> bool:
        """Whether the scenario is over or the robot has fallen."""
        return self.fell or self.plant.tick >= self._last_tick

    @property
    def own_end(self) -> tuple[ModeCause, str]:
        """Cause of the end of a run that was not cut off, also in words."""
        if self._fall is not None:
            return ModeCause.FELL, f"at {self._fell_at_s:.2f} s: {self._fall.detail}"
        return ModeCause.RUN_OVER, f"{self.time_s:g} s"

    def sense(self) -> Snapshot:
        """Read the sensors at the present tick; the same reading if asked again."""
        if self._sensed is None:
            self._sensed = self._faults.apply(self.plant.sense())
        return self._sensed

    @property
    def missing_sensors(self) -> tuple[str, ...]:
        """Channels whose message of the present tick a fault suppresses."""
        return self._faults.missing

    @property
    def unread_sensors(self) -> tuple[str, ...]:
        """Channels that the controller cannot read: not sent, or not readable."""
        return self._faults.unread

    def truth(self) -> PlantTruth:
        """Return the true state at the present tick."""
        if self._truth is None:
            self._truth = self.plant.truth()
        return self._truth

    def commands_needed(self, tick: int) -> int | None:
        """Return the tick whose answer is needed before ``tick`` can step.

        Returns:
            ``tick`` minus the command delay; None while nothing is needed yet.
        """
        return self._delay.needed(tick)

    def apply(self, q_command: Array, *, tick: int) -> None:
        """Take the answer to a tick; it acts once its delay is over.

        Args:
            q_command: (n_a,) positions passed by the gate [rad]; copied.
            tick: the tick that the command answers.

        Raises:
            CommandError: the answered tick is to come, or no step is left for it.
        """
        self._delay.put(q_command, answers=tick, now=self.plant.tick)

    def step(self) -> None:
        """Advance one tick with the command that is due, or else the one before."""
        self.advance(self._delay.take(self.plant.tick))

    def advance(self, q_command: Array) -> None:
        """Advance one tick with a command that acts at once, as in real time.

        Args:
            q_command: (n_a,) commanded positions [rad].

        Raises:
            CommandError: the command has the wrong size.
        """
        snapshot = self.sense()
        self._metrics.update(self.plant.view, tick=self.plant.tick)
        if self._walk is not None:
            self._walk.update(self.plant.view)
        if self._recorder is not None:
            self._recorder.add(self.truth(), snapshot, q_command)
        self.plant.step(q_command)
        self._digest.add(snapshot, q_command)
        self._truth = None
        self._sensed = None
        if self._fell_at_s is None and self.plant.fell:
            self._fell_at_s = self.time_s
            self._fall = self.plant.diagnose_fall()

    def wait(self, q_command: Array) -> None:
        """Let one tick's time pass before the scenario begins at tick 0.

        Args:
            q_command: (n_a,) commanded positions [rad].

        Raises:
            CommandError: the scenario has begun.
        """
        if self.plant.tick:
            raise CommandError(
                f"wait: at tick {self.plant.tick}, expected before the first step"
            )
        self.plant.wait(q_command)
        self._sensed = self._truth = None

    def push(self, request: PushRequest) -> Answer:
        """Push the robot from the next tick on, or return why not; record the push."""
        try:
            tick = self.plant.push(request)
        except ScenarioError as error:
            return Answer(RequestRefusal.BAD_VALUE, str(error))
        self._asked_pushes.append(
            PushEvent(
                tick=tick,
                source=request.source,
                body=request.body,
                force_n=request.force_n,
                duration_s=request.duration_s,
            )
        )
        return DONE

    def result(
        self,
        *,
        real_time_factor: float,
        round_trip_ms: Distribution,
        period_jitter_ms: Distribution,
        deadline_misses: int,
        refused: dict[str, int],
        clipped: dict[str, int],
        gate: ModeReport = COMMANDED,
        cut_off: tuple[ModeCause, str] | None = None,
    ) -> PlantResult:
        """Return the result of the run; the loop supplies timings and counts.

        Args:
            real_time_factor: simulated time over elapsed time.
            round_trip_ms: times from sensors sent to command received [ms].
            period_jitter_ms: lateness of ticks [ms].
            deadline_misses: ticks that went on without their command.
            refused: number of refused commands by reason.
            clipped: number of clipped commands by limit.
            gate: state of the gate at the end.
            cut_off: cause of an early end, and the same in words; None when the
                scenario was over, or the robot fell.
        """
        end, end_detail = cut_off or self.own_end
        return PlantResult(
            fell=self.fell,
            fell_at_s=self._fell_at_s,
            fall=None if self._fall is None else self._fall.criterion,
            fall_detail="" if self._fall is None else self._fall.detail,
            end=end,
            end_detail=end_detail,
            gate=gate,
            duration_s=self.time_s,
            **self._metrics.figures(),
            real_time_factor=real_time_factor,
            round_trip_ms=round_trip_ms,
            period_jitter_ms=period_jitter_ms,
            deadline_misses=deadline_misses,
            ticks=self.tick,
            refused=refused,
            clipped=clipped,
            log_sha256=self._digest.hexdigest(),
            pushes=self._asked_pushes,
            recorded_ground=self._recorded_ground,
            distance_m=None if self._walk is None else self._walk.distance,
            touchdown_peak_n=None if self._walk is None else self._walk.touchdown_peak,
        )
