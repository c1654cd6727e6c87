"""A ROS 2 robot with genuine rclpy: driven, checked, and shown to ROS 2."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deploy.driver.ros2_settings import load_settings
from surefoot.robot_io.client_side.observer import Observer
from surefoot.robot_io.robot import find_robot, load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.schemas.errors import FileFormatError
from tests.command import (
    REPOSITORY,
    Surefoot,
    command,
    cut_short,
    environment,
)
from tests.patient_robot import JUDGED, patient_robot_file
from tests.robot_io.conformance.verdict import check_passes_but_for_time
from tests.support import PATIENCE_S, wait_until

DRIVER = REPOSITORY / "deploy" / "driver"
SHIPPED = DRIVER / "ros2.toml"
LISTENER = Path(__file__).with_name("ros2_listener.py")
DOMAINS = 100
"""Number of domains for which ROS 2 has ports on every system."""
STILL_RAD = 2e-5
KNEE = ("[joints]", '[joints]\nleft_knee = "LKneePitch"\n', 1)
MOST_COM_ERROR_MM = 30.0
MOST_DISTANCE_M = 0.01
SPEEDS = (0.2, 0.2, 0.1)
"""Speeds of the attempts as a share of real time; a busy machine may need all."""
LAST_S = 2.3


def ros2_python() -> str | None:
    """Return the Python that has rclpy: of `make ros2`, or this one."""
    own = REPOSITORY / ".venv-ros2" / "bin" / "python"
    if own.is_file():
        return str(own)
    return sys.executable if importlib.util.find_spec("rclpy") else None


needs_ros2 = pytest.mark.skipif(
    ros2_python() is None, reason="rclpy is not installed: `make ros2` brings it"
)


def ros2_environment(folder: Path) -> dict[str, str]:
    """Return an environment for this host only, in a domain of this test's own."""
    return {
        **environment(),
        "ROS_DOMAIN_ID": str(os.getpid() % DOMAINS + 1),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "ros2"),
    }


@contextmanager
def started(words: list[Any], folder: Path, **more: Any) -> Iterator[subprocess.Popen]:
    """Run a process; at the end it is asked to stop, and killed if it does not."""
    process = subprocess.Popen(
        list(map(str, words)), env=ros2_environment(folder), text=True, **more
    )
    try:
        yield process
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)
    finally:
        process.kill()
        process.wait()


def program(name: str, *words: object) -> list[object]:
    return [ros2_python(), DRIVER / f"ros2_{name}.py", *words]


def slow_rate(robot: Path, rate_hz: float) -> Path:
    """Return the same robot at a lower rate, which a busy machine can keep."""
    path = robot.with_name("slow.toml")
    path.write_text(f"rate_hz = {rate_hz}\n{robot.read_text()}")
    return path


def patient_settings(
    folder: Path, text: str = "", *, start_s: float = PATIENCE_S, speed: float = 1.0
) -> Path:
    """Return driver settings, by default the shipped ones, with long time limits."""
    path = folder / "ros2.toml"
    text = text or SHIPPED.read_text()
    patient = text.replace("max_age_s = 0.05", "max_age_s = 1.0")
    clock = f"[clock]\nspeed = {speed}\nstart_s = {start_s}"
    path.write_text(patient.replace("[clock]", clock))
    return path


def wait_until_still(robot: Path, endpoints: Endpoints) -> None:
    """Wait until the servos are at rest under the posture that the driver holds."""
    model = load_robot(str(robot))
    with Observer(model, endpoints=endpoints, channels=("joints",)) as observer:
        observer.connect(timeout_s=PATIENCE_S)
        postures: list[list[float]] = []

        def is_still() -> bool:
            latest = observer.latest()
            if "joints" in latest:
                postures.append(latest["joints"].q)
            recent = np.array(postures[-100:])
            return len(recent) == 100 and bool(np.ptp(recent, axis=0).max() < STILL_RAD)

        wait_until(is_still, what="a robot at rest")


@needs_ros2
@pytest.mark.slow
def test_the_fast_platform_through_ros2_both_ways(
    tmp_path: Path, endpoint_file: Path
) -> None:
    robot = slow_rate(patient_robot_file(tmp_path), 500.0)
    scenario = cut_short("moving-platform-fast", tmp_path, LAST_S)
    for speed in SPEEDS:
        end, heard = balanced(scenario, robot, endpoint_file, speed=speed)
        if max(end["com_error_max_mm"]) < MOST_COM_ERROR_MM:
            break
    assert not end["fell"]
    assert end["duration_s"] == pytest.approx(LAST_S)
    assert max(end["com_error_max_mm"]) < MOST_COM_ERROR_MM
    check_what_ros2_heard(heard, robot)


def balanced(
    scenario: Path, robot: Path, endpoint_file: Path, *, speed: float
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the robot's result, and what ROS 2 heard."""
    folder = scenario.parent
    settings = patient_settings(folder, speed=speed)
    plant_words = [scenario, settings, "--robot", robot]
    shown = [endpoint_file, robot, "--rate", 10, "--wait", PATIENCE_S]
    words = ["--realtime", "--robot", robot, "--endpoints", endpoint_file]
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with (
        started([ros2_python(), LISTENER, robot], folder, **piped) as listener,
        started(program("driver", endpoint_file, settings, robot), folder),
        started(program("publisher", *shown), folder),
        started(command("stabilizer", *words), folder, stdout=subprocess.DEVNULL),
        started(program("simulated_robot", *plant_words), folder, **piped) as plant,
    ):
        out, err = plant.communicate(timeout=PATIENCE_S)
        assert out, err
        listener.send_signal(signal.SIGTERM)
        heard_out, heard_err = listener.communicate(timeout=PATIENCE_S)
    assert heard_out, heard_err
    return json.loads(out), json.loads(heard_out)


def check_what_ros2_heard(heard: dict[str, Any], robot: Path) -> None:
    """Check that RViz and rosbag get state, frames, wrenches and status."""
    model = load_robot(str(robot))
    assert heard["names"] == model.joint_names
    assert heard["description"] == model.urdf_path.read_text()
    for topic in ("base_pose", "joint_states", "joint_commands", "left_sole/desired"):
        assert heard["counts"][f"/surefoot/{topic}"] > 10, topic
    assert heard["force"]["/surefoot/right_sole/measured"][2] > 100.0
    said = heard["said"][f"{model.file.name}: stabilizer"]
    assert any(word.startswith("active") for word in said)
    frames = {child: (parent, np.array(p)) for parent, child, p in heard["frames"]}
    base = f"surefoot/{model.file.base_link}"
    parent, place = frames[base]
    assert parent == "surefoot/world"
    assert abs(place[2] - model.file.nominal_base_height_m) < MOST_DISTANCE_M
    soles = [frames[f"surefoot/{foot.sole_frame}"] for foot in model.file.foot]
    assert [parent for parent, _ in soles] == [base, base]
    # The base stands level in the nominal posture: heights add up.
    assert all(abs(place[2] + sole[2]) < MOST_DISTANCE_M for _, sole in soles)


@needs_ros2
def test_a_ros2_robot_passes_the_conformance_run(
    surefoot: Surefoot, tmp_path: Path, endpoint_file: Path, endpoints: Endpoints
) -> None:
    robot = slow_rate(patient_robot_file(tmp_path, **JUDGED), 200.0)
    by_name = SHIPPED.read_text().replace(
        "std_msgs/Float64MultiArray", "sensor_msgs/JointState"
    )
    pushed = by_name.replace("ground_on_robot", "robot_on_ground", 1)
    settings = patient_settings(tmp_path, pushed.replace(*KNEE))
    simulated = program("simulated_robot", "standing", settings, "--robot", robot)
    with started(simulated, tmp_path, stdout=subprocess.DEVNULL):
        check_mistakes(pushed, endpoint_file)
        judge(surefoot, settings, robot, endpoint_file, endpoints)


def judge(
    surefoot: Surefoot, settings: Path, robot: Path, file: Path, endpoints: Endpoints
) -> None:
    folder = settings.parent
    with started(program("driver", file, settings, robot), folder):
        wait_until_still(robot, endpoints)
        words = ["--endpoints", file, "--robot", robot, "--wait", PATIENCE_S]
        done = surefoot("check-robot", *words, "--json")
    check_passes_but_for_time(done)


def check_mistakes(text: str, endpoint_file: Path) -> None:
    """Check names and qualities of service that the robot does not have."""
    folder = endpoint_file.parent / "mistaken"
    folder.mkdir()
    settings = patient_settings(folder, text, start_s=5.0)
    refused(settings, endpoint_file, code=2, expected="no joint left_knee; it has")
    reliable = text.replace(*KNEE).replace("[imu]", 'reliability = "reliable"\n[imu]')
    settings = patient_settings(folder, reliable, start_s=5.0)
    refused(settings, endpoint_file, code=4, expected="set its reliability")


@needs_ros2
def test_a_driver_without_a_robot_says_so(tmp_path: Path, endpoint_file: Path) -> None:
    settings = patient_settings(tmp_path, start_s=1.0)
    refused(settings, endpoint_file, code=4, expected="wrench: nobody publishes it")


def refused(settings: Path, endpoint_file: Path, *, code: int, expected: str) -> None:
    """Check that a driver that cannot start says why in one line."""
    done = subprocess.run(
        list(map(str, program("driver", endpoint_file, settings))),
        env=ros2_environment(settings.parent),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert expected in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert done.returncode == code


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('topic = "/imu/data"', 'topik = "/imu/data"', "did you mean"),
        ('topic = "/imu/data"', 'topic = "/joint_states"', "used twice"),
        ("[joints]", '[joints]\nleft_nee = "LKnee"', "'left_knee'"),
        ("[joints]", '[joints]\nleft_knee = "right_knee"', "two joints"),
        ("[joints]", 'joints = ["left_knee"]\n[joints]', "each of the 28 joints"),
        ("Float64MultiArray", "Float32", "command.type"),
        ("[right_ankle_ft]", "[imu2]", "imu2"),
    ],
)
def test_a_mistaken_file_is_refused_by_its_key(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    path = tmp_path / "ros2.toml"
    path.write_text(SHIPPED.read_text().replace(old, new, 1))
    with pytest.raises(FileFormatError, match=expected) as refused:
        load_settings(path, load_robot("walker"))
    assert str(path) in str(refused.value)


def test_a_robot_without_ankle_sensors_has_no_topics_for_them(tmp_path: Path) -> None:
    robot = tmp_path / "virtual.toml"
    robot.write_text(f'extends = "{find_robot("walker")}"\n[virtual_ft]\n')
    with pytest.raises(FileFormatError, match="leave the ankle's topic out"):
        load_settings(SHIPPED, load_robot(str(robot)))
    before, _, after = SHIPPED.read_text().partition("[left_ankle_ft]")
    path = tmp_path / "ros2.toml"
    path.write_text(before + "[command]" + after.partition("[command]")[2])
    assert set(load_settings(path, load_robot(str(robot))).sensors) == {"joints", "imu"}
    with pytest.raises(FileFormatError, match="left_ankle_ft: missing"):
        load_settings(path, load_robot("walker"))
