"""The other side of :mod:`benchmarks.peers`, which runs in the venv of the peers.

It reads a folder, then measures once for every line on its standard input. It answers
with a line of JSON: name -> CPU time of one call [us], or the reason for its absence.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

Call = Callable[[int], None]


def dynamics_call(about: dict[str, Any], states: Any, urdf: str) -> Call:
    """PlaCo's inverse dynamics: two planar contacts, CoM, base, posture, limits."""
    placo = importlib.import_module("placo")
    robot = placo.RobotWrapper(urdf, placo.Flags.ignore_collisions)
    solver = placo.DynamicsSolver(robot)
    _place(robot, states, 0)
    for frame in about["soles"]:
        task = solver.add_frame_task(frame, robot.get_T_world_frame(frame))
        contact = solver.add_planar_contact(task)
        contact.length, contact.width = about["length"], about["width"]
        contact.mu = about["friction"]
    _add_tasks(solver, about, robot)
    solver.enable_torque_limits(True)

    def call(index: int) -> None:
        _place(robot, states, index)
        if not solver.solve().success:
            raise RuntimeError("PlaCo's DynamicsSolver found no solution")

    return call


def kinematics_call(about: dict[str, Any], states: Any, urdf: str) -> Call:
    """PlaCo's inverse kinematics: both soles, CoM, base, posture, velocity limits."""
    placo = importlib.import_module("placo")
    robot = placo.RobotWrapper(urdf, placo.Flags.ignore_collisions)
    solver = placo.KinematicsSolver(robot)
    solver.dt = about["period_s"]
    _place(robot, states, 0)
    for frame in about["soles"]:
        task = solver.add_frame_task(frame, robot.get_T_world_frame(frame))
        task.configure(frame, "soft", 1e3, 1e3)
    _add_tasks(solver, about, robot)
    solver.enable_velocity_limits(True)

    def call(index: int) -> None:
        _place(robot, states, index)
        solver.solve(False)

    return call


def _add_tasks(solver: Any, about: dict[str, Any], robot: Any) -> None:
    solver.add_com_task(np.array(about["com"])).configure("com", "soft", 10.0)
    base = solver.add_orientation_task(about["base"], np.eye(3))
    base.configure("base", "soft", 1.0)
    posture = solver.add_joints_task()
    posture.set_joints(dict(zip(about["joints"], about["posture"], strict=True)))
    posture.configure("posture", "soft", 1e-2)


def _place(robot: Any, states: Any, index: int) -> None:
    robot.state.q, robot.state.qd = states["q"][index], states["v"][index]
    robot.update_kinematics()


def pink_call(about: dict[str, Any], states: Any, urdf: str) -> Call:
    """Inverse kinematics by pink, with DAQP: the same tasks."""
    pin, pink = importlib.import_module("pinocchio"), importlib.import_module("pink")
    importlib.import_module("pink.tasks")
    model = pin.buildModelFromUrdf(urdf, pin.JointModelFreeFlyer())
    data = model.createData()
    configuration = pink.Configuration(model, data, states["q"][0])
    soles = [pink.FrameTask(f, 10.0, 10.0) for f in about["soles"]]
    base = pink.FrameTask(about["base"], 0.0, 1.0)
    tasks = [*soles, base, pink.tasks.ComTask(3.0), pink.PostureTask(1e-1)]
    for task in tasks:
        task.set_target_from_configuration(configuration)

    def call(index: int) -> None:
        configuration.update(states["q"][index])
        pink.solve_ik(configuration, tasks, about["period_s"], solver="daqp")

    return call


def qp_call(solver: str, problems: Any, name: str) -> Call:
    """One of our QPs per call, with another solver."""
    module = importlib.import_module(solver)
    cost, c, rows, h = (problems[f"{name}_{key}"] for key in ("P", "q_lin", "G", "h_u"))
    low, high = problems[f"{name}_x_l"], problems[f"{name}_x_u"]
    n, m = cost.shape[1], rows.shape[1]
    if solver == "daqp":
        upper = np.minimum(np.hstack((high, h)), 1e30)
        lower = np.maximum(np.hstack((low, np.full((len(cost), m), -np.inf))), -1e30)
        sense = np.zeros(n + m, dtype=np.int32)

        def call(i: int) -> None:
            _, _, flag, _ = module.solve(
                cost[i], c[i], rows[i], upper[i], lower[i], sense
            )
            if flag < 1:
                raise RuntimeError(f"daqp ends with {flag}")
    else:
        boxed = np.isfinite(low[0])
        eye = np.eye(n)[boxed]

        def call(i: int) -> None:
            below = np.vstack((-rows[i], eye, -eye))
            bound = np.concatenate((-h[i], low[i][boxed], -high[i][boxed]))
            module.solve_qp(cost[i], -c[i], below.T, bound)

    return call


def main() -> None:
    """Build all calls that are available, then measure at every line."""
    folder = Path(sys.argv[1])
    about = json.loads((folder / "about.json").read_text())
    states, problems = np.load(folder / "states.npz"), np.load(folder / "problems.npz")
    states = {name: states[name] for name in states.files}
    problems = {name: problems[name] for name in problems.files}
    urdf = str(folder / "robot.urdf")
    makers: dict[str, Callable[[], Call]] = {
        "placo dynamics": lambda: dynamics_call(about, states, urdf),
        "placo kinematics": lambda: kinematics_call(about, states, urdf),
        "pink": lambda: pink_call(about, states, urdf),
    }
    for solver in ("daqp", "quadprog", "eiquadprog"):
        for name in ("tsid", "dik"):
            makers[f"{solver} {name}"] = partial(qp_call, solver, problems, name)
    calls: dict[str, Call] = {}
    absent: dict[str, str] = {}
    count = {name: len(states["q"]) for name in makers}
    for name, make in makers.items():
        try:
            calls[name] = make()
            for index in range(5):
                calls[name](index)
        except Exception as error:  # of any library: reported; the rest is measured
            calls.pop(name, None)
            absent[name] = f"{type(error).__name__}: {str(error).splitlines()[0]}"
        if " " in name and name.split()[1] in ("tsid", "dik"):
            count[name] = len(problems[f"{name.split()[1]}_P"])
    print(json.dumps(absent), flush=True)
    for _ in sys.stdin:
        times = {name: _median(call, count[name]) for name, call in calls.items()}
        print(json.dumps(times), flush=True)


def _median(call: Call, count: int) -> float:
    times = []
    for index in range(count):
        begin = time.thread_time_ns()
        call(index)
        times.append(time.thread_time_ns() - begin)
    return float(np.median(times)) / 1e3


if __name__ == "__main__":
    main()
