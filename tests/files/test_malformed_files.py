"""A malformed user file works, or is refused in one line with exit code 2."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

import surefoot as sf
from surefoot.errors import ExitCode, exit_code_of
from surefoot.robot_io.bus import session
from surefoot.robot_io.bus.session import Role, session_config
from surefoot.robot_io.errors import LocatorError, RobotFileError
from surefoot.robot_io.relay.lane import Lane
from surefoot.robot_io.relay.relay import PLANS_DIR
from surefoot.robot_io.robot import ROBOTS_DIR, load_robot
from surefoot.run_plan import resolve_settings, settings_text
from surefoot.schemas.endpoints import load_endpoints
from surefoot.schemas.relay_plan import load_relay_plan
from surefoot.schemas.settings import ControllerSettings
from surefoot.sim_robot.catalogue import SCENARIOS_DIR
from surefoot.sim_robot.robot_spec import read_urdf
from surefoot.view.robot_shape import RobotShape
from tests.files.malformed_files import malformed_toml, malformed_urdf

FEW, MANY = 20, 200
COUNTS = [FEW, pytest.param(MANY, marks=pytest.mark.slow)]
WALKER = ROBOTS_DIR / "walker"
STEPS = 3
ENDPOINTS = """\
listen = ["tcp/127.0.0.1:7447"]
connect = ["tcp/127.0.0.1:7447"]
router = ["tcp/127.0.0.1:7448"]
lease_ms = 500
retry_ms = 50
max_bytes = 16384
insecure = false

[access]
stabilizer = ["stabilizer"]
observer = ["observer", "guest"]
"""


def verdicts(
    write: Callable[[int], None], read: Callable[[], object], count: int, name: str
) -> Counter[str]:
    """Count files accepted and refused; fail at the first other outcome."""
    told: Counter[str] = Counter()
    for seed in range(count):
        write(seed)
        error = error_of(read)
        told["taken" if error is None else "refused"] += 1
        if error is not None:
            assert exit_code_of(error) is ExitCode.USAGE, f"{seed}: {error!r}"
            assert "\n" not in str(error).strip(), f"{seed}: {error}"
            assert name in str(error), f"{seed}: {error}"
    assert told["refused"] > count / 10
    return told


def error_of(read: Callable[[], object]) -> Exception | None:
    try:
        read()
    except Exception as error:
        return error
    return None


def check_malformed_tomls(
    path: Path, texts: list[str], read: Callable[[], object], count: int
) -> None:
    """Check each text in turn, changed, as the file that is read."""

    def write(seed: int) -> None:
        path.write_bytes(malformed_toml(texts[seed % len(texts)], seed))

    verdicts(write, read, count, str(path))


def stand(robot: str | Path, scenario: str | Path) -> None:
    """Run some ticks, through all code that reads both files."""
    sim = sf.Simulation(robot, scenario, seed=0)
    controller = sf.make_controller("whole-body", sim.plan.robot)
    for _ in range(STEPS):
        sim.step(controller)


@pytest.mark.parametrize("count", COUNTS)
def test_urdfs(count: int, files: Path) -> None:
    urdf = files.with_suffix(".urdf")
    text = urdf.read_text()

    def write(seed: int) -> None:
        urdf.write_bytes(malformed_urdf(text, seed))

    verdicts(write, lambda: stand(files, "standing"), count, str(files.parent))


@pytest.mark.parametrize("count", COUNTS)
def test_robot_files(count: int, files: Path) -> None:
    texts = [files.read_text()]
    check_malformed_tomls(files, texts, lambda: stand(files, "standing"), count)


@pytest.mark.parametrize("count", COUNTS)
def test_scenarios(count: int, tmp_path: Path) -> None:
    texts = [path.read_text() for path in sorted(SCENARIOS_DIR.glob("*.toml"))]
    path = tmp_path / "odd.toml"
    check_malformed_tomls(path, texts, lambda: stand("walker", path), count)


@pytest.mark.parametrize("count", COUNTS)
def test_settings(count: int, tmp_path: Path) -> None:
    path = tmp_path / "odd.toml"

    def read() -> None:
        sf.make_controller("whole-body", "walker", settings=path)
        settings_text(resolve_settings(path))

    texts = [settings_text(ControllerSettings())]
    check_malformed_tomls(path, texts, read, count)


@pytest.mark.parametrize("count", COUNTS)
def test_endpoint_files(count: int, tmp_path: Path) -> None:
    path = tmp_path / "odd.toml"

    def read() -> None:
        endpoints = load_endpoints(path)
        for role in Role:
            try:
                session.check_endpoints(endpoints, role)
            except LocatorError as error:  # which names locators, wherever from
                raise LocatorError(f"{path}: {error}") from error
            config = session_config(endpoints, role, namespace="a", timeout_s=1.0)
            zenoh.Config.from_json5(session.json.dumps(config))

    check_malformed_tomls(path, [ENDPOINTS], read, count)


@pytest.mark.parametrize("count", COUNTS)
def test_relay_plans(count: int, tmp_path: Path) -> None:
    texts = [path.read_text() for path in sorted(PLANS_DIR.glob("*.toml"))]
    path = tmp_path / "odd.toml"

    def read() -> None:
        plan = load_relay_plan(path)
        for channel in ("joints", "joint_command", "status"):
            lane = Lane(plan, channel, seed=0)
            for number in range(5):
                lane.pass_on(b"\x80", now_s=0.1 * number, elapsed_s=0.1 * number)

    check_malformed_tomls(path, texts, read, count)


HEAD_YAW = 'joint name="head_yaw" type="revolute"'
CASES = {
    "no body has it": (
        r'ixx="0.609826"', 'ixx="2.0"', r"link 'torso': inertial: .*no body has these"
    ),
    "negative inertia": (r'ixx="0.609826"', 'ixx="-1"', "all must be above 0"),
    "not positive": (r'ixy="0" ixz="0.00486976"', 'ixy="3" ixz="0"', "above 0"),
    "in g mm2": (r'ixx="0.609826" iyy="0.514282" izz="0.436567"',
                 'ixx="609826" iyy="514282" izz="436567"', "in kg m.2 about"),
    "negative mass": (r'mass value="19.8612"', 'mass value="-1"', "negative"),
    "massless link": (r'mass value="0.1052"', 'mass value="0"',
                      "joint 'head_yaw' moves link 'neck', which has no mass"),
    "in grams": (r'mass value="([\d.]+)"', r'mass value="\g<1>e3"', "masses in kg"),
    "continuous": (HEAD_YAW, 'joint name="head_yaw" type="continuous"',
                   "joint 'head_yaw': type 'continuous'; make it revolute"),
    "planar": (HEAD_YAW, 'joint name="head_yaw" type="planar"', "'planar'; only"),
    "floating": (HEAD_YAW, 'joint name="head_yaw" type="floating"', "the base floats"),
    "mimic": (f"<{HEAD_YAW}>", f'<{HEAD_YAW}><mimic joint="head_pitch"/>', "mimic"),
    "twice": ('joint name="head_pitch"', 'joint name="head_yaw"', "two joints are cal"),
    "no parent": ('parent link="torso"', 'parent link="gone"', "link 'gone', which is"),
    "reversed": ('lower="-1.6572" upper="1.6572"', 'lower="1" upper="-1"', "not below"),
    "in degrees": ('upper="1.6572"', 'upper="95"', "is it in degrees"),
    "not finite": ('upper="1.6572"', 'upper="nan"', "got 'nan', expected a number"),
    "no direction": ('axis xyz="0 0 1"', 'axis xyz="0 0 0"', "expected a direction"),
    "broken": ("</robot>", "", "not valid XML"),
    "no number": ('lower="-1.6572"', 'lower="low"', "lower: got 'low', expected a num"),
    "no effort": (' effort="3.5"', "", "effort: got ''"),
    "no limit": (r'<limit lower="-1.6572"[^>]*/>', "", "'head_yaw' has no <limit>"),
    "other": (r"<robot name", "<sdf/><robot name", "not valid XML"),
    "in millimetres": (r'origin xyz="([-\d.]+) ([-\d.]+) ([-\d.]+)"',
                       r'origin xyz="\g<1>e3 \g<2>e3 \g<3>e3"', "lengths in metres"),
}  # fmt: skip


def changed(path: Path, old: str, new: str) -> None:
    text, count = re.subn(old, new, path.read_text())
    assert count
    path.write_text(text)


@pytest.mark.parametrize("case", CASES)
def test_a_urdf_that_no_robot_has_is_refused_with_link_or_joint(
    case: str, files: Path
) -> None:
    old, new, words = CASES[case]
    changed(files.with_suffix(".urdf"), old, new)
    with pytest.raises(RobotFileError, match=words) as caught:
        load_robot(str(files))
    assert str(files.parent) in str(caught.value)
    assert exit_code_of(caught.value) is ExitCode.USAGE


@pytest.mark.parametrize("mesh", ["gone.stl", "package://walker/torso.stl"])
def test_meshes_are_needed_for_pictures_alone(mesh: str, files: Path) -> None:
    shape = f'<geometry><mesh filename="{mesh}"/></geometry>'
    changed(
        files.with_suffix(".urdf"),
        '<link name="torso">',
        f'<link name="torso"><visual>{shape}</visual><collision>{shape}</collision>',
    )
    stand(files, "standing")
    with pytest.raises(RobotFileError, match=r"link 'torso': mesh .*leave out the"):
        RobotShape(load_robot(str(files)))


def test_without_shapes_the_model_is_the_same(files: Path) -> None:
    """What collides in a URDF never counted; its inertia is written."""
    urdf = files.with_suffix(".urdf")
    mass = read_urdf(urdf, visuals=False).compile().body_mass.sum()
    changed(urdf, r"(?s)<collision>.*?</collision>", "")
    assert read_urdf(urdf, visuals=False).compile().body_mass.sum() == mass
