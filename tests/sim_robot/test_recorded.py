from __future__ import annotations

import math
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from surefoot.schemas.motions import STANDARD_GRAVITY, RecordedMotion
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.motion import motion_law
from surefoot.sim_robot.recorded import recorded_track

IMU = """std_msgs/Header header
geometry_msgs/Vector3 linear_acceleration
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
===
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
""".replace("===", 80 * "=")
RATE_HZ = 100.0
LENGTH_S = 20.0
TIMES = np.arange(round(LENGTH_S * RATE_HZ) + 1) / RATE_HZ
# A shake of 0.1 m that begins and ends at rest, and its derivatives.
_ENVELOPE = np.sin(math.pi * TIMES / LENGTH_S) ** 4
POSITION = 0.1 * _ENVELOPE * np.sin(math.tau * 0.8 * TIMES)
VELOCITY = np.gradient(POSITION, 1.0 / RATE_HZ, edge_order=2)
ACCELERATION = np.gradient(VELOCITY, 1.0 / RATE_HZ, edge_order=2)


def _csv(path: Path, values: np.ndarray, *, heading: str = "") -> str:
    lines = [f"{t:.6f},{v:.12g}" for t, v in zip(TIMES, values, strict=True)]
    path.write_text(heading + "\n".join(lines) + "\n")
    return str(path)


def _motion(file: str, **keys: object) -> RecordedMotion:
    return RecordedMotion(axis="x", file=file, **keys)  # type: ignore[arg-type]


def _on(motion: RecordedMotion, times: np.ndarray) -> np.ndarray:
    law = motion_law(motion)
    return np.array([law(float(t))[0] for t in times])


def test_without_drift_removal_it_is_scipys_integral(tmp_path: Path) -> None:
    file = _csv(tmp_path / "a.csv", ACCELERATION)
    moved = _on(_motion(file, quantity="acceleration", drift_hz=0.0), TIMES)
    expected = CubicSpline(TIMES, ACCELERATION).antiderivative(2)(TIMES)
    assert moved == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("quantity", "values"),
    [("position", POSITION), ("velocity", VELOCITY), ("acceleration", ACCELERATION)],
)
def test_the_same_shake_from_any_quantity(
    tmp_path: Path, quantity: str, values: np.ndarray
) -> None:
    moved = _on(_motion(_csv(tmp_path / "a.csv", values), quantity=quantity), TIMES)
    assert moved == pytest.approx(POSITION, abs=2e-3)


def test_offset_and_slow_drift_of_the_sensor_do_not_move_the_ground(
    tmp_path: Path,
) -> None:
    wrong = ACCELERATION + 9.81 + 0.02 * np.sin(math.tau * 0.01 * TIMES)
    moved = _on(
        _motion(_csv(tmp_path / "a.csv", wrong), quantity="acceleration"), TIMES
    )
    middle = slice(300, -300)
    assert moved[middle] == pytest.approx(POSITION[middle], abs=8e-3)
    _, last = motion_law(_motion(str(tmp_path / "a.csv"), quantity="acceleration"))(
        LENGTH_S + 1.0
    )
    assert last == 0.0


def test_a_sensor_that_warms_up_does_not_kick_the_ground_at_both_ends(
    tmp_path: Path,
) -> None:
    """A straight line, of which a high-pass alone leaves a step where it begins."""
    wrong = ACCELERATION + 0.1 * TIMES
    motion = _motion(_csv(tmp_path / "a.csv", wrong), quantity="acceleration")
    assert _on(motion, TIMES) == pytest.approx(POSITION, abs=2e-3)
    largest = np.abs(recorded_track(motion).acceleration).max()
    assert largest == pytest.approx(np.abs(ACCELERATION).max(), rel=0.01)


def test_velocity_is_the_derivative_and_has_no_jump(tmp_path: Path) -> None:
    file = _csv(tmp_path / "a.csv", np.cos(TIMES))  # begins at full speed
    law = motion_law(_motion(file, quantity="velocity", start_s=0.5, drift_hz=0.0))
    assert law(0.5) == (0.0, 0.0)
    for index in range(2000):
        time_s = 0.45 + 0.00137 + 1e-3 * index
        (before, _), (_, velocity), (after, _) = (
            law(time_s + shift) for shift in (-1e-6, 0.0, 1e-6)
        )
        assert velocity == pytest.approx((after - before) / 2e-6, abs=1e-4)
    assert law(0.5 + 0.010)[1] == pytest.approx(0.5, abs=0.02)
    assert law(0.5 + 0.021)[1] == pytest.approx(1.0, abs=0.02)


def test_units_scale_and_cut(tmp_path: Path) -> None:
    file = _csv(tmp_path / "p.csv", 1e3 * POSITION)
    motion = _motion(
        file, quantity="position", units="mm", scale=-0.5, from_s=5.0, to_s=15.0
    )
    moved = _on(motion, TIMES[:1000])
    expected = -0.5 * (POSITION[500:1500] - POSITION[500])
    assert moved == pytest.approx(expected, abs=5e-3)
    assert np.ptp(recorded_track(motion).position) == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize(
    ("text", "keys", "field", "words"),
    [
        ("0,0\n1,1\n", {"quantity": "position"}, "file", "2 samples"),
        ("0,0\n1,1\n1,1\n2,1\n", {"quantity": "position"}, "file", "rising"),
        (
            "0,0\n1,a\n2,1\n3,1\n",
            {"quantity": "position"},
            "file",
            "line 2: column 2 is .a., expected a number",
        ),
        ("0,0\n1,1\n2,1\n3,1\n", {}, "quantity", "missing"),
        ("t,a\n0,0\n", {"quantity": "position", "column": "b"}, "column", "t, a"),
        ("0,0\n1,1e9\n2,0\n3,1\n", {"quantity": "position"}, "file", "SI units"),
        (
            "0,0\n1,1e308\n2,-1e308\n3,1\n",
            {"quantity": "position"},
            "file",
            "scale right",
        ),
    ],
)
def test_a_bad_file_is_named_with_the_key(
    tmp_path: Path, text: str, keys: dict[str, str], field: str, words: str
) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=words) as caught:
        motion_law(_motion(str(path), **keys))
    assert caught.value.field == field


def test_a_file_that_was_changed_is_read_anew(tmp_path: Path) -> None:
    motion = _motion(_csv(tmp_path / "p.csv", POSITION), quantity="position")
    before, then = recorded_track(motion), os.stat(motion.file)
    _csv(tmp_path / "p.csv", 2.0 * POSITION, heading="t,x\n")
    os.utime(motion.file, ns=(then.st_atime_ns, then.st_mtime_ns))  # as cp -p would
    after = recorded_track(motion)
    assert after.sha256 != before.sha256
    assert np.ptp(after.position) == pytest.approx(2.0 * np.ptp(before.position))


def test_an_imu_of_ros_2(tmp_path: Path) -> None:
    writer_of = pytest.importorskip(
        "mcap_ros2.writer", reason="needs mcap-ros2-support: pip install -e .[dev]"
    )
    path = tmp_path / "deck.mcap"
    with path.open("wb") as file:
        writer = writer_of.Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
        for time_s, value in zip(TIMES, ACCELERATION, strict=True):
            stamp = 10**18 + round(1e9 * time_s)
            writer.write_message(
                topic="/imu",
                schema=schema,
                message={
                    "header": {
                        "stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}
                    },
                    "linear_acceleration": {"x": value, "y": 0.0, "z": 9.81},
                },
                log_time=stamp + 5_000_000,
                publish_time=stamp,
            )
        writer.finish()
    here = {"quantity": "acceleration", "channel": "/imu"}
    moved = _on(_motion(str(path), field="linear_acceleration.x", **here), TIMES)
    assert moved == pytest.approx(POSITION, abs=2e-3)


@pytest.mark.slow
def test_el_centro_has_the_peaks_that_are_published(tmp_path: Path) -> None:
    """North-south, 1940: 0.319 g, some 0.35 m/s, 0.1 to 0.2 m by how one filters."""
    fetched = subprocess.run(
        [
            *(sys.executable, "-m", "pip", "download", "sdof==0.0.7", "--no-deps"),
            *("--no-binary", ":all:", "--dest", str(tmp_path)),
        ],
        capture_output=True,
        check=False,
    )
    if fetched.returncode != 0:
        pytest.skip("El Centro's record cannot be fetched from here")
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as archive:
        archive.extractall(tmp_path, filter="data")
    (record,) = tmp_path.rglob("elCentro.AT2")
    track = recorded_track(_motion(str(record)))
    assert np.abs(track.acceleration).max() == pytest.approx(
        0.319 * STANDARD_GRAVITY, rel=0.02
    )
    assert np.abs(track.velocity).max() == pytest.approx(0.35, rel=0.1)
    assert 0.08 < np.abs(track.position).max() < 0.25


def test_a_record_that_moves_nothing_is_refused(tmp_path: Path) -> None:
    file = _csv(tmp_path / "a.csv", np.full_like(TIMES, 9.81))
    with pytest.raises(ScenarioError, match="does not move the ground in x") as caught:
        recorded_track(_motion(file, quantity="acceleration"))
    assert caught.value.field == "file"


def test_a_pipe_is_no_record(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(ScenarioError, match="is no file, expected a record"):
        recorded_track(_motion(str(tmp_path / "a.csv"), quantity="velocity"))


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"cannot be read .*null"):
        recorded_track(_motion("a\0.csv", quantity="velocity"))
