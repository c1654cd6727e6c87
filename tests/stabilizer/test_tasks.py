"""A custom task for both QPs, from outside the packages."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import msgspec
import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.reference import Stance
from surefoot.stabilizer.control.tasks import SelectionTask, Task, standing_tasks
from surefoot.stabilizer.control.tsid import Tsid
from surefoot.stabilizer.dynamics import Dynamics
from surefoot.stabilizer.model import N_BASE_V, RobotModel
from surefoot.stabilizer.whole_body.controller import WholeBodyController
from tests.stabilizer.closed_loop import run_closed_loop
from tests.stabilizer.explicit_dik import solve_explicit
from tests.stabilizer.least_distance import LeastDistanceSolver
from tests.stabilizer.rig import CONTACT_NAMES, CONTACT_SETS, Rig
from tests.stabilizer.states import nominal_state, states_near_stance
from tests.stabilizer.uncondensed_tsid import solve_uncondensed

EXAMPLE = Path(__file__).parents[2] / "examples" / "hand_task.py"
STATES = 10
SPREAD, SPEED = 0.05, 0.2
SAME_FORCE_N = 1e-4
SAME_VELOCITY = 1e-4
HAND_MM = 3.0
NEAR = 1e-6


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hand_task", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class HeadTask(SelectionTask):
    """The first joint turns at a given rate; it selects one entry of v."""

    size = 1
    columns = slice(N_BASE_V, N_BASE_V + 1)

    def __init__(self) -> None:
        self.acceleration_weights = np.array([0.3])
        self.velocity_weights = np.array([0.7])
        self.rate = 0.4

    def acceleration(self, dynamics: Dynamics, stance: Stance, out: Array) -> None:
        out[:] = 2.0 * self.rate - dynamics.v[self.columns]

    def velocity(
        self, dynamics: Dynamics, stance: Stance, q_command: Array, out: Array
    ) -> None:
        out[:] = self.rate

    def retune(self, settings: ControllerSettings) -> None:
        self.rate = settings.dik.posture_gain


@pytest.fixture
def extra_tasks(example: ModuleType, model: RobotModel) -> list[Task]:
    """Return a task with a Jacobian, and one on v itself."""
    target = np.array([0.2, 0.3, 0.7])
    return [example.HandTask(model.frame_id("left_hand"), target), HeadTask()]


@pytest.mark.parametrize("in_contact", CONTACT_SETS, ids=CONTACT_NAMES)
def test_first_qp_has_the_tasks_given_to_it(
    model: RobotModel, extra_tasks: list[Task], in_contact: list[bool]
) -> None:
    rig, without = Rig(model, extra_tasks=extra_tasks), Rig(model)
    for state in states_near_stance(
        model, count=STATES, seed=31, spread=SPREAD, speed=SPEED
    ):
        rig.go(state)
        without.go(state)
        assert rig.solve_tsid(in_contact).residuals().worst < NEAR
        assert without.solve_tsid(in_contact).ok
        rows = [row for row in range(12) if in_contact[row // 6]]
        paper = solve_uncondensed(rig, in_contact)
        np.testing.assert_allclose(rig.tsid.F_id[rows], paper.F, atol=SAME_FORCE_N)
        assert np.abs(rig.tsid.F_id - without.tsid.F_id).max() > 1.0


def test_second_qp_has_the_tasks_given_to_it(
    model: RobotModel, extra_tasks: list[Task]
) -> None:
    rig, without = Rig(model, extra_tasks=extra_tasks), Rig(model)
    rng = np.random.default_rng(32)
    for state in states_near_stance(
        model, count=STATES, seed=33, spread=SPREAD, speed=SPEED
    ):
        rig.go(state)
        without.go(state)
        r, q_command = 0.05 * rng.normal(size=12), state.q[7:].copy()
        solution = rig.solve_dik(r, q_command=q_command)
        assert solution.residuals().worst < NEAR
        v = solve_explicit(rig, r, q_command=q_command)
        np.testing.assert_allclose(solution.x, v, atol=SAME_VELOCITY)
        assert np.abs(solution.x - without.solve_dik(r).x).max() > 0.05


def test_selection_copies_what_its_jacobian_says(model: RobotModel) -> None:
    """The quick way of base and posture is the way of every other task."""
    settings = ControllerSettings()
    tasks = standing_tasks(model, settings)
    written_out = [Multiplied(task) for task in tasks]
    quick, slow = Rig(model), Rig(model)
    slow.tsid = Tsid(model, settings.tsid, written_out)
    slow.dik = type(slow.dik)(model, settings.dik, written_out)
    rng = np.random.default_rng(34)
    for state in states_near_stance(
        model, count=STATES, seed=35, spread=SPREAD, speed=SPEED
    ):
        for rig in (quick, slow):
            rig.go(state)
            assert rig.solve_tsid().ok
        np.testing.assert_allclose(quick.tsid.F_id, slow.tsid.F_id, atol=SAME_FORCE_N)
        r = 0.05 * rng.normal(size=12)
        np.testing.assert_allclose(
            quick.solve_dik(r).x, slow.solve_dik(r).x, atol=SAME_VELOCITY
        )


class Multiplied(Task):
    """The same task, given by Jacobian and drift only."""

    def __init__(self, task: Task) -> None:
        self.size = task.size
        self.acceleration_weights = task.acceleration_weights
        self.velocity_weights = task.velocity_weights
        self.jacobian = task.jacobian  # type: ignore[method-assign]
        self.weights_without = task.weights_without  # type: ignore[method-assign]
        self.drift = task.drift  # type: ignore[method-assign]
        self.acceleration = task.acceleration  # type: ignore[method-assign]
        self.velocity = task.velocity  # type: ignore[method-assign]

    def jacobian(self, dynamics: Dynamics) -> Array:
        raise AssertionError


@pytest.mark.parametrize("qp", ["acceleration", "velocity"])
def test_task_may_be_left_out_of_either_qp(model: RobotModel, qp: str) -> None:
    task = HeadTask()
    setattr(task, f"{qp}_weights", None)
    rig, plain = Rig(model, extra_tasks=[task]), Rig(model)
    for each in (rig, plain):
        each.go(nominal_state(model))
    tsid = rig.solve_tsid().x, plain.solve_tsid().x
    dik = rig.solve_dik(np.zeros(12)).x, plain.solve_dik(np.zeros(12)).x
    left_out, kept = (tsid, dik) if qp == "acceleration" else (dik, tsid)
    np.testing.assert_array_equal(*left_out)
    assert np.abs(kept[0] - kept[1]).max() > NEAR


@pytest.mark.parametrize("weights", [np.ones(2), np.array(1.0), np.array([-1.0])])
@pytest.mark.parametrize("qp", ["acceleration", "velocity"])
def test_weights_must_fit_the_rows(model: RobotModel, qp: str, weights: Array) -> None:
    task = HeadTask()
    setattr(task, f"{qp}_weights", weights)
    with pytest.raises(ValueError, match=r"HeadTask: got weights .* expected 1 number"):
        Rig(model, extra_tasks=[task])


@pytest.mark.parametrize("method", ["drift", "acceleration", "velocity"])
def test_what_a_task_forgot_is_said_by_name(rig: Rig, method: str) -> None:
    class Forgetful(Task):
        size = 1

        def jacobian(self, dynamics: Dynamics) -> Array:
            return dynamics.J_com[:1]

    arguments = {
        "drift": (rig.dynamics,),
        "acceleration": (rig.dynamics, rig.stance, np.zeros(1)),
        "velocity": (rig.dynamics, rig.stance, np.zeros(28), np.zeros(1)),
    }
    with pytest.raises(NotImplementedError, match=rf"Forgetful .* no {method}\(\)"):
        getattr(Forgetful(), method)(*arguments[method])


def test_gains_changed_later_reach_extra_tasks(walker: Robot) -> None:
    task = HeadTask()
    settings = ControllerSettings()
    controller = WholeBodyController(walker, settings, extra_tasks=[task])
    dik = msgspec.structs.replace(settings.dik, posture_gain=0.125)
    controller.retune(msgspec.structs.replace(settings, dik=dik))
    assert task.rate == 0.125


@pytest.mark.closed_loop
def test_hand_reaches_its_target_while_the_robot_stands(
    example: ModuleType, walker: Robot
) -> None:
    controller, task = example.reaching_controller(walker)
    first = np.linalg.norm(example.FORWARD_UP_M)
    run = run_closed_loop(walker, controller=controller, duration_s=4.0)
    assert not run.fell
    assert run.statuses == {"ok"}
    error_mm = 1e3 * np.linalg.norm(task.error(controller.dynamics))
    assert error_mm < HAND_MM < 1e3 * first


def test_both_qps_take_another_solver(walker: Robot) -> None:
    """Through a start and a push hard enough for limits to press."""
    made: list[LeastDistanceSolver] = []

    def make() -> LeastDistanceSolver:
        made.append(LeastDistanceSolver())
        return made[-1]

    push = [
        {
            "body": "torso",
            "force_n": [0.0, 300.0, 0.0],
            "start_s": 0.5,
            "duration_s": 0.1,
        }
    ]
    settings = ControllerSettings()
    runs = [
        run_closed_loop(walker, controller=controller, duration_s=0.8, push=push)
        for controller in (
            WholeBodyController(walker, settings, solver=make),
            WholeBodyController(walker, settings),
        )
    ]
    assert sum(solver.solved for solver in made) > 0
    assert len(made) == 6
    assert runs[0].statuses == runs[1].statuses == {"ok"}
    np.testing.assert_allclose(runs[0].commands, runs[1].commands, atol=1e-4)
