from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from surefoot.robot_io.robot import Robot
from surefoot.robot_io.snapshot import (
    Delivery,
    Snapshot,
    SnapshotLayout,
    sensor_messages,
)
from surefoot.robot_io.snapshot import readings as readings_of
from surefoot.schemas.arrays import Array
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.messages import Message
from surefoot.schemas.sensors import SENSORS
from surefoot.sim_robot.catalogue import ScenarioError
from surefoot.sim_robot.plant import Plant
from tests.sim_robot.conftest import MakePlant

PERIOD_NS = 1_000_000
SHAKE = [
    {
        "foot": "both",
        "motion": [
            {"axis": "y", "kind": "sine", "amplitude_m": 0.01, "frequency_hz": 2.0},
            {"axis": "z", "kind": "sine", "amplitude_m": 0.01, "frequency_hz": 3.0},
        ],
    }
]
TICKS = 60
NAMES = [entry.name for entry in SENSORS]


def readings(plant: Plant, posture: Array, *, ticks: int = TICKS) -> Iterator[Snapshot]:
    for _ in range(ticks):
        yield plant.sense()
        plant.step(posture)


def shaken(make_plant: MakePlant, robot: Robot, **keys: object) -> list[Snapshot]:
    return list(readings(make_plant(platform=SHAKE, **keys), robot.nominal))


@pytest.fixture(scope="module")
def prompt(make_plant: MakePlant, walker: Robot) -> list[Snapshot]:
    """Return the snapshots of a robot that sends every sensor at once."""
    return shaken(make_plant, walker)


def measured_ticks(snapshot: Snapshot, name: str) -> int:
    return snapshot.measured_ns[NAMES.index(name)] // PERIOD_NS


def test_a_slow_sensor_holds_its_reading_and_tells_when_it_was_measured(
    make_plant: MakePlant, walker: Robot, prompt: list[Snapshot]
) -> None:
    slow = shaken(make_plant, walker, sensors={"force_torque_rate_hz": 200.0})
    for tick, snapshot in enumerate(slow):
        then = tick - tick % 5
        assert snapshot.stamp_ns == tick * PERIOD_NS
        assert measured_ticks(snapshot, "left_ankle_ft") == then
        assert measured_ticks(snapshot, "imu") == tick
        np.testing.assert_array_equal(snapshot.ft_left, prompt[then].ft_left)
        np.testing.assert_array_equal(snapshot.ft_right, prompt[then].ft_right)
        np.testing.assert_array_equal(snapshot.q, prompt[tick].q)


def test_a_rate_that_does_not_divide_is_kept_on_average(
    make_plant: MakePlant, walker: Robot
) -> None:
    slow = shaken(make_plant, walker, sensors={"joints_rate_hz": 300.0})
    taken = sorted({measured_ticks(s, "joints") for s in slow})
    assert len(taken) == pytest.approx(0.3 * TICKS, abs=1)
    assert set(np.diff(taken)) == {3, 4}


def test_a_slow_accelerometer_still_integrates_to_the_velocity(
    make_plant: MakePlant, walker: Robot, prompt: list[Snapshot]
) -> None:
    """Five readings of 1 ms and one of 5 ms tell the same change of velocity."""
    slow = shaken(make_plant, walker, sensors={"imu_rate_hz": 200.0})
    for tick in range(10, TICKS, 5):
        fast = np.mean(
            [prompt[t].linear_acceleration for t in range(tick - 4, tick + 1)], 0
        )
        np.testing.assert_allclose(slow[tick].linear_acceleration, fast, atol=0.02)


@pytest.mark.parametrize(
    ("delay", "force", "joints", "imu"),
    [({"force_torque": 2.0, "joints": 5.0}, 2, 5, 0), (3.0, 3, 3, 3)],
    ids=["each", "all"],
)
def test_each_kind_of_sensor_has_its_own_delay(
    make_plant: MakePlant,
    walker: Robot,
    prompt: list[Snapshot],
    delay: Any,
    force: int,
    joints: int,
    imu: int,
) -> None:
    """And reports the past under the present tick."""
    late = shaken(make_plant, walker, delay={"sensor_ms": delay})
    for tick, snapshot in enumerate(late):
        assert (snapshot.tick, snapshot.stamp_ns) == (tick, tick * PERIOD_NS)
        for fields, name, ticks in (
            (("ft_left", "ft_right"), "right_ankle_ft", force),
            (("q", "dq"), "joints", joints),
            (("angular_velocity", "linear_acceleration"), "imu", imu),
        ):
            then = max(0, tick - ticks)
            assert measured_ticks(snapshot, name) == then
            for field in fields:
                expected = getattr(prompt[then], field)
                np.testing.assert_array_equal(getattr(snapshot, field), expected)


def test_jitter_is_bounded_in_order_and_the_same_for_a_seed(
    make_plant: MakePlant, walker: Robot
) -> None:
    delay = {"sensor_ms": 1.0, "jitter_ms": 3.0}
    one, other = (shaken(make_plant, walker, delay=delay) for _ in range(2))
    then = np.array([measured_ticks(s, "imu") for s in one])
    late = np.arange(TICKS) - then
    assert set(late[4:]) == {1, 2, 3, 4}
    assert (np.diff(then) >= 0).all()
    assert [s.measured_ns for s in one] == [s.measured_ns for s in other]
    assert (then != [measured_ticks(s, "joints") for s in one]).any()


def test_messages_are_stamped_when_they_were_measured(
    make_plant: MakePlant, walker: Robot
) -> None:
    late = shaken(make_plant, walker, delay={"sensor_ms": {"force_torque": 2.0}})[-1]
    messages = dict(zip(NAMES, sensor_messages(late, stamp_ns=10**10), strict=True))
    assert messages["joints"].stamp_ns == 10**10
    assert messages["left_ankle_ft"].stamp_ns == 10**10 - 2 * PERIOD_NS
    assert messages["left_ankle_ft"].tick == late.tick


@pytest.mark.parametrize("missing", [(), ("imu",), ("left_ankle_ft",)])
def test_delivery_tells_of_stamps_what_messages_tell(
    make_plant: MakePlant, walker: Robot, missing: tuple[str, ...]
) -> None:
    """In one process and on the bus a controller must see the same."""
    delay = {"sensor_ms": {"force_torque": 2.0}, "jitter_ms": 2.0}
    layout, delivery = SnapshotLayout(walker.n_a), Delivery()
    newest: dict[str, Message] = {}
    for snapshot in shaken(make_plant, walker, delay=delay):
        lost = missing if snapshot.tick % 3 == 2 else ()
        sent = sensor_messages(snapshot, stamp_ns=snapshot.stamp_ns)
        newest |= {n: m for n, m in zip(NAMES, sent, strict=True) if n not in lost}
        joined = layout.join(snapshot.tick, list(newest.values()))
        delivered, _ = delivery.deliver(snapshot, lost)
        assert delivered.measured_ns == joined.measured_ns
        assert delivered.stamp_ns == joined.stamp_ns
        for one, other in zip(readings_of(delivered), readings_of(joined), strict=True):
            np.testing.assert_array_equal(one, other)


def test_errors_of_each_axis_and_side(make_plant: MakePlant) -> None:
    clean = make_plant().sense()
    wrong = make_plant(
        sensors={
            "force_bias_n": {"left": [0.0, 0.0, -30.0]},
            "moment_scale": {"right": 2.0},
            "moment_bias_nm": -0.5,
            "accel_bias_m_s2": [0.0, 0.0, 0.03],
            "gyro_scale": [1.0, 1.1, 1.0],
            "gyro_bias_rad_s": 0.01,
            "force_scale": 0.5,
        }
    ).sense()
    np.testing.assert_allclose(
        wrong.ft_left[:3], 0.5 * clean.ft_left[:3] + [0.0, 0.0, -30.0]
    )
    np.testing.assert_allclose(wrong.ft_right[:3], 0.5 * clean.ft_right[:3])
    np.testing.assert_allclose(wrong.ft_right[3:], 2.0 * clean.ft_right[3:] - 0.5)
    np.testing.assert_allclose(wrong.ft_left[3:], clean.ft_left[3:] - 0.5)
    rate = clean.angular_velocity * [1.0, 1.1, 1.0] + 0.01
    np.testing.assert_allclose(wrong.angular_velocity, rate, atol=1e-12)
    shift = wrong.linear_acceleration - clean.linear_acceleration
    np.testing.assert_allclose(shift, [0.0, 0.0, 0.03], atol=1e-12)


def test_offsets_drift_by_the_minute(make_plant: MakePlant, walker: Robot) -> None:
    keys = {
        "gyro_drift_rad_s_min": [0.6, 0.0, 0.0],
        "force_drift_n_min": {"left": 60.0},
    }
    ticks = 31
    drifting = list(readings(make_plant(sensors=keys), walker.nominal, ticks=ticks))[-1]
    clean = list(readings(make_plant(), walker.nominal, ticks=ticks))[-1]
    np.testing.assert_allclose(
        drifting.angular_velocity - clean.angular_velocity, [0.6 * 0.03 / 60, 0, 0]
    )
    np.testing.assert_allclose(drifting.ft_left[:3] - clean.ft_left[:3], 0.03)
    np.testing.assert_array_equal(drifting.ft_right, clean.ft_right)


def test_encoder_offsets_by_joint(make_plant: MakePlant, walker: Robot) -> None:
    name = "left_ankle_roll"
    plant = make_plant(sensors={"encoder_offset_rad": {name: 0.02}})
    shift = plant.sense().q - make_plant().sense().q
    expected = np.zeros(walker.n_a)
    expected[walker.joint_names.index(name)] = 0.02
    np.testing.assert_allclose(shift, expected, atol=1e-12)
    with pytest.raises(ScenarioError, match="did you mean 'left_ankle_roll'"):
        make_plant(sensors={"encoder_offset_rad": {"left_ankle_rol": 0.02}})


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"sensors": {"imu_rate_hz": 2000.0}}, "at most the 1000 ticks"),
        ({"delay": {"jitter_ms": 0.3}}, r"delay\.jitter_ms: got 0\.3 ms"),
        ({"delay": {"sensor_ms": {"imu": 0.3}}}, r"delay\.sensor_ms\.imu: got 0\.3"),
    ],
)
def test_what_the_robot_cannot_do_is_refused(
    make_plant: MakePlant, table: dict[str, object], words: str
) -> None:
    with pytest.raises(ScenarioError, match=words):
        make_plant(**table)


@pytest.mark.parametrize(
    "sensors",
    [
        {"force_noise_n": [1.0, -1.0, 1.0]},
        {"force_bias_n": [1.0, 2.0]},
        {"gyro_bias_rad_s": {"left": 1.0}},
        {"force_bias_n": {"front": 1.0}},
    ],
)
def test_what_is_no_such_value_is_refused(
    make_plant: MakePlant, sensors: dict[str, object]
) -> None:
    with pytest.raises(FileFormatError, match=next(iter(sensors))):
        make_plant(sensors=sensors)
