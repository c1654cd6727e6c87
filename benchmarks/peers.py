"""Surefoot compared with other libraries that do the same computations.

    python -m benchmarks.peers [--quick] [--out out/peers]

The others are installed from ``benchmarks/peers-requirements.txt`` into a venv of their
own, the folder ``venv`` beside the results. One that is not available gets a line in
the table. Both sides run on one core, one after the other in every pair, and count CPU
time. A ratio is ours over theirs: the median of all pairs with an interval of order
statistics.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from benchmarks.peers_bus import BEYOND_PACKING, FOUR_MESSAGES, bus_times
from surefoot.robot_io.realtime import quiet_interpreter
from surefoot.robot_io.urdf_check import without_shapes
from surefoot.schemas.settings import ControllerSettings
from surefoot.simulation import Simulation
from surefoot.stabilizer.qp import DenseQp, QpStatus
from surefoot.stabilizer.whole_body.controller import WholeBodyController

HERE = Path(__file__).parent
US_PER_NS = 1e-3
SETTLED_TICKS = 800
EVERY = 10
"""One tick in so many is kept: its state and its two QPs."""


class Comparison(NamedTuple):
    """A ratio to compute: names of the two times, ours and theirs."""

    ours: str
    theirs: tuple[str, ...]


COMPARISONS = (
    Comparison("whole tick", ("placo dynamics", "placo kinematics")),
    Comparison("dynamics to DIK", ("placo dynamics", "placo kinematics")),
    Comparison("dynamics and TSID", ("placo dynamics",)),
    Comparison("DIK", ("placo kinematics",)),
    Comparison("DIK", ("pink",)),
    *(
        Comparison(f"{ours} {name}", (f"{solver} {name}",))
        for name in ("tsid", "dik")
        for solver in ("daqp", "quadprog", "eiquadprog")
        for ours in ("own QP", "PIQP")
    ),
    Comparison("whole tick", ("floor",)),
    Comparison("bus round trip", ("bare Zenoh",)),
    Comparison(BEYOND_PACKING, ("bare Zenoh",)),
    Comparison("bus round trip", (FOUR_MESSAGES,)),
    Comparison(BEYOND_PACKING, (FOUR_MESSAGES,)),
    Comparison("bus round trip", ("raw sockets",)),
)


class Ratio(NamedTuple):
    """Ours over theirs: the median of the pairs and its interval."""

    median: float
    low: float
    high: float


def ratio_of(ours: Sequence[float], theirs: Sequence[float]) -> Ratio:
    """Return the median ratio of pairs and its interval.

    Of ten pairs the second and the ninth ratio enclose the median with 97.9 %. Of
    fewer than eight pairs, the interval is the least and the largest ratio.
    """
    ratios = sorted(a / b for a, b in zip(ours, theirs, strict=True))
    cut = 1 if len(ratios) >= 8 else 0
    return Ratio(float(np.median(ratios)), ratios[cut], ratios[-1 - cut])


def table_of(pairs: Sequence[dict[str, float]], absent: dict[str, str]) -> str:
    """Return the comparisons as a Markdown table."""
    lines = [
        "| Surefoot | | beside | | ours / theirs | interval |",
        "|---|---|---|---|---|---|",
    ]
    for ours, theirs in COMPARISONS:
        label = " + ".join(theirs)
        missing = [name for name in theirs if any(name not in pair for pair in pairs)]
        if missing or any(ours not in pair for pair in pairs):
            name = missing[0] if missing else ours
            why = absent.get(name, "not measured")
            lines.append(f"| {ours} | | {label} | | none: {why} | |")
            continue
        a = [pair[ours] for pair in pairs]
        b = [sum(pair[name] for name in theirs) for pair in pairs]
        ratio = ratio_of(a, b)
        lines.append(
            f"| {ours} | {np.median(a):.0f} us | {label} | {np.median(b):.0f} us "
            f"| {ratio.median:.2f} | {ratio.low:.2f} to {ratio.high:.2f} |"
        )
    return "\n".join(lines)


def make_venv(folder: Path) -> tuple[Path, dict[str, str]]:
    """Make the others' venv unless it exists; return its Python, and the failures."""
    python = folder / "bin" / "python"
    failed: dict[str, str] = {}
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    for line in (HERE / "peers-requirements.txt").read_text().splitlines():
        if not line or line.startswith("#"):
            continue
        pip = ["-m", "pip", "install", "-q", "--only-binary", ":all:"]
        pip = [str(python), *pip, line]
        done = subprocess.run(pip, check=False, capture_output=True, text=True)
        if done.returncode:
            words = (done.stderr.strip() or "pip failed").splitlines()
            failed[line] = next((w for w in words if w.startswith("ERROR")), words[-1])
            print(f"{line}: {failed[line]}")
    return python, failed


class Witness:
    """Controls the simulation, and keeps its readings for a second controller.

    The second one computes the same without a simulator between its ticks: its caches
    are as warm as those of the others.
    """

    def __init__(self, controller: WholeBodyController) -> None:
        """Begin without readings."""
        self.controller = controller
        self.seen: list[Any] = []
        self.twin: WholeBodyController | None = None

    def start(self, snapshot: Any, q_command: Any) -> None:
        """Start both controllers."""
        self.controller.start(snapshot, q_command)
        if self.twin is not None:
            self.twin.start(copy.deepcopy(snapshot), q_command.copy())

    def step(self, snapshot: Any, reference: Any = None) -> Any:
        """Answer, and keep the reading."""
        self.seen.append(copy.deepcopy(snapshot))
        return self.controller.step(snapshot, reference)


class Own:
    """Our side: a controller of a standing robot, its states, and both QPs at each."""

    def __init__(self, robot: str, scenario: str, *, ticks: int) -> None:
        """Run until the robot stands, then keep states and QPs."""
        self.sim = Simulation(robot, scenario)
        settings = ControllerSettings()
        self.witness = Witness(WholeBodyController(self.sim.robot, settings))
        c = self.controller = WholeBodyController(self.sim.robot, settings)
        self.witness.twin = c
        self.times: dict[str, list[int]] = {}
        self.tsid = c.tsid.problem([True, True])
        self.states: dict[str, list[Any]] = {"q": [], "v": []}
        self.problems: dict[str, list[Any]] = {}
        for tick in range(SETTLED_TICKS + ticks):
            self._advance()
            if tick >= SETTLED_TICKS and tick % EVERY == 0:
                self._keep()
        self._time(c, "step", "whole tick")
        for part, method in (
            (c.dynamics, "update"),
            (c.tsid, "solve"),
            (c.law, "update"),
            (c.dik, "solve"),
        ):
            self._time(part, method, type(part).__name__)

    def _advance(self) -> None:
        """Step the simulation, then the measured controller by itself."""
        self.sim.step(self.witness)
        self._replay()

    def _replay(self) -> None:
        for snapshot in self.witness.seen:
            self.controller.step(snapshot)
        self.witness.seen.clear()

    def _keep(self) -> None:
        c = self.controller
        self.states["q"].append(c.dynamics.q.copy())
        self.states["v"].append(c.dynamics.v.copy())
        for qp in (self.tsid, c.dik.qp):
            data = qp.data(QpStatus.OK)
            for key in ("P", "q_lin", "G", "h_u", "x_l", "x_u"):
                self.problems.setdefault(f"{qp.name}_{key}", []).append(
                    getattr(data, key)
                )

    def _time(self, owner: object, method: str, name: str) -> None:
        original, times = getattr(owner, method), self.times.setdefault(name, [])

        def call(*args: Any, **kwargs: Any) -> Any:
            begin = time.thread_time_ns()
            result = original(*args, **kwargs)
            times.append(time.thread_time_ns() - begin)
            return result

        setattr(owner, method, call)

    def dump(self, folder: Path) -> None:
        """Write the files that the other side reads."""
        c, robot = self.controller, self.sim.robot
        model = c.model.pin_model
        xml = without_shapes(robot.urdf_path)
        (folder / "robot.urdf").write_text(xml)
        np.savez(folder / "states.npz", allow_pickle=False, **self.states)
        np.savez(folder / "problems.npz", allow_pickle=False, **self.problems)
        links = ElementTree.fromstring(xml)
        children = {e.get("link") for e in links.iter("child")}
        names = [e.get("name") for e in links.findall("link")]
        about = {
            "soles": [foot.sole_frame for foot in robot.file.foot],
            "length": 2.0 * c.model.half_sizes[0][0],
            "width": 2.0 * c.model.half_sizes[0][1],
            "friction": 0.7,
            "com": c.stance.com.tolist(),
            "base": next(name for name in names if name not in children),
            "joints": list(model.names)[2:],
            "posture": c.stance.posture.tolist(),
            "period_s": robot.period_s,
        }
        (folder / "about.json").write_text(json.dumps(about))

    def measure(self, ticks: int) -> dict[str, float]:
        """Return medians of one round [us]."""
        for values in self.times.values():
            values.clear()
        for _ in range(ticks):
            self.sim.step(self.witness)
        self._replay()
        got = {k: float(np.median(v)) * US_PER_NS for k, v in self.times.items()}
        named = {"whole tick": got["whole tick"], "DIK": got["Dik"]}
        named["dynamics and TSID"] = got["Dynamics"] + got["Tsid"]
        named["dynamics to DIK"] = sum(got.values()) - got["whole tick"]
        tick = np.array(self.times["whole tick"])
        named["p99.9 over median"] = float(np.quantile(tick, 0.999) / np.median(tick))
        count = len(self.states["q"])
        for name in ("tsid", "dik"):
            arrays = {
                k[len(name) + 1 :]: v for k, v in self.problems.items() if name in k
            }
            n, m = arrays["q_lin"][0].size, arrays["h_u"][0].size
            qp = DenseQp(name, n=n, m=m)
            for title, solve in (
                (f"own QP {name}", qp.solve),
                (f"PIQP {name}", partial(qp._solver.solve, qp)),
            ):
                named[title] = _median(count, solve, partial(_fill, qp, arrays))
        named["floor"] = (
            _median(count, *self._pinocchio())
            + named["own QP tsid"]
            + named["own QP dik"]
        )
        return named

    def _pinocchio(self) -> tuple[Callable[[], object], Callable[[int], None]]:
        """Return Pinocchio's computations of a tick, in as few calls as possible."""
        model = self.controller.model.pin_model
        data, zero, now = model.createData(), np.zeros(model.nv), [0]

        def call() -> None:
            q, v = self.states["q"][now[0]], self.states["v"][now[0]]
            pin.computeMinverse(model, data, q)
            pin.computeAllTerms(model, data, q, v)
            pin.centerOfMass(model, data, q, v, zero)

        return call, lambda i: now.__setitem__(0, i)


def _fill(qp: DenseQp, arrays: dict[str, Any], index: int) -> None:
    for key, values in arrays.items():
        getattr(qp, key)[:] = values[index]


def _median(
    count: int, call: Callable[[], object], prepare: Callable[[int], None]
) -> float:
    times = []
    for index in range(count):
        prepare(index)
        begin = time.thread_time_ns()
        call()
        times.append(time.thread_time_ns() - begin)
    return float(np.median(times)) * US_PER_NS


def main() -> None:
    """Measure all pairs and write table and numbers."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out/peers"))
    parser.add_argument("--robot", default="walker")
    parser.add_argument("--scenario", default="standing")
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--quick", action="store_true", help="short rounds")
    options = parser.parse_args()
    ticks = 150 if options.quick else 600
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    options.out.mkdir(parents=True, exist_ok=True)
    python, absent = make_venv(options.out / "venv")
    own = Own(options.robot, options.scenario, ticks=600)
    own.dump(options.out)
    cores = os.sched_getaffinity(0)
    command = [str(python), str(HERE / "peers_other.py"), str(options.out)]
    alone = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    with (
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=alone
        ) as other,
        quiet_interpreter(),
    ):
        assert other.stdin is not None
        assert other.stdout is not None
        os.sched_setaffinity(0, {min(cores)})
        os.sched_setaffinity(other.pid, {min(cores)})
        absent |= json.loads(other.stdout.readline())
        pairs = []
        for _ in range(options.pairs):
            pair = own.measure(ticks)
            other.stdin.write("\n")
            other.stdin.flush()
            pair |= json.loads(other.stdout.readline())
            pairs.append(pair)
        other.stdin.close()
    os.sched_setaffinity(0, cores)
    for pair in pairs:
        pair |= bus_times(own.sim.robot, ticks)
    table = table_of(pairs, absent)
    (options.out / "peers.json").write_text(
        json.dumps({"pairs": pairs, "absent": absent}, indent=1)
    )
    (options.out / "peers.md").write_text(table + "\n")
    print(table)
    worst = np.median([pair["p99.9 over median"] for pair in pairs])
    print(f"\nwhole tick: p99.9 is {worst:.2f} times the median")


if __name__ == "__main__":
    main()
