"""Time of each stage of a controller tick: estimator, dynamics, both QPs, walk, codec.

    python -m benchmarks.bench_tick [SCENARIO] [--ticks N]

It prints one table per phase of a walk, or one table for a robot that stands.

Plant and controller run in one process, as in ``surefoot run --inline``. Each stage of
the controller is timed where it is called, with caches as cold as in a run. Set
OPENBLAS_NUM_THREADS=1, as ``surefoot`` does itself.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from surefoot.robot_io.realtime import quiet_interpreter
from surefoot.robot_io.snapshot import Snapshot, sensor_messages
from surefoot.schemas import codec, messages
from surefoot.schemas.settings import ControllerSettings
from surefoot.simulation import Simulation
from surefoot.stabilizer.whole_body.controller import WholeBodyController

WARM_UP_TICKS = 500
US_PER_NS = 1e-3


class Stopwatch:
    """Collects durations of calls by name, and by phase."""

    def __init__(self) -> None:
        """Begin without measurements."""
        self.phase = "stand"
        self.durations_ns: dict[str, dict[str, list[int]]] = {}

    def wrap(self, owner: object, method: str, name: str) -> None:
        """Replace a method of one object by a timed one."""
        original = getattr(owner, method)
        setattr(owner, method, self.timed(original, name))

    def timed(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        """Return the function with its calls timed under a name."""
        durations = self.durations_ns.setdefault(name, {})
        clock = time.perf_counter_ns

        def call(*args: Any, **kwargs: Any) -> Any:
            start = clock()
            result = function(*args, **kwargs)
            durations.setdefault(self.phase, []).append(clock() - start)
            return result

        return call

    def table(self, phase: str) -> str:
        """Return a phase's lower decile, median, p99 and maximum by name [us].

        A noisy machine changes the lower decile least.
        """
        lines = [f"{phase:<26}{'p10':>9}{'median':>9}{'p99':>9}{'max':>9}   [us]"]
        skipped = WARM_UP_TICKS if phase == "stand" else 0
        for name, durations in self.durations_ns.items():
            times = np.array(durations.get(phase, [])[skipped:]) * US_PER_NS
            if len(times):
                figures = (*np.percentile(times, (10, 50, 99)), times.max())
                lines.append(f"{name:<26}" + "".join(f"{x:9.1f}" for x in figures))
        return "\n".join(lines)


def run(scenario_name: str, *, ticks: int) -> str:
    """Run a scenario and report the stages."""
    sim = Simulation("walker", scenario_name)
    controller = WholeBodyController(sim.robot, ControllerSettings())
    walk = controller.walk
    watch = Stopwatch()
    watch.wrap(controller, "step", "controller tick")
    watch.wrap(controller.observer.estimator, "update", "  estimator")
    watch.wrap(controller.dynamics, "update", "  dynamics")
    watch.wrap(controller.observer.wrenches, "update", "  wrench compensation")
    watch.wrap(controller.tsid, "solve", "  TSID")
    watch.wrap(controller.law, "update", "  wrench law")
    watch.wrap(controller.dik, "solve", "  DIK")
    watch.wrap(walk, "update", "  walk: references")
    watch.wrap(walk, "swing_twist", "  walk: swing twist")
    watch.wrap(sim.simulated.plant, "sense", "plant: sense")
    watch.wrap(sim.simulated.plant, "step", "plant: step")
    watch.wrap(sim.gate, "accept", "command gate")
    encode = watch.timed(_encode_snapshot, "codec: encode 4 sensors")
    decode = watch.timed(_decode_snapshot, "codec: decode 4 sensors")
    with quiet_interpreter():
        for _ in range(ticks):
            watch.phase = walk.gait.phase.value
            decode(encode(sim.snapshot))
            sim.step(controller)
            if sim.finished:
                break
    phases = dict.fromkeys(p for d in watch.durations_ns.values() for p in d)
    return "\n\n".join(watch.table(phase) for phase in phases)


def _encode_snapshot(snapshot: Snapshot) -> list[tuple[bytes, type[messages.Message]]]:
    parts = sensor_messages(snapshot, stamp_ns=0)
    return [(codec.encode(part), type(part)) for part in parts]


def _decode_snapshot(parts: list[tuple[bytes, type[messages.Message]]]) -> None:
    for data, kind in parts:
        codec.decode(data, kind)


def main() -> None:
    """Read the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="moving-platform-slow")
    parser.add_argument("--ticks", type=int, default=8000)
    arguments = parser.parse_args()
    print(run(arguments.scenario, ticks=arguments.ticks))


if __name__ == "__main__":
    main()
