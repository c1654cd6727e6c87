from __future__ import annotations

import math

import pytest

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.motions import SineMotion
from surefoot.schemas.scenario import Scenario, scenario_from_table
from surefoot.schemas.scenario_paths import (
    override_scenario,
    scenario_paths,
)
from surefoot.schemas.toml_file import parse_override


def ramp(axis: str, amplitude_deg: float) -> dict[str, object]:
    return {
        "kind": "ramp",
        "axis": axis,
        "amplitude_deg": amplitude_deg,
        "rate_deg_s": 10.0,
    }


@pytest.fixture
def scenario() -> Scenario:
    sine = {"kind": "sine", "axis": "roll", "amplitude_deg": 8.6, "frequency_hz": 1.0}
    drop = {"kind": "drop", "axis": "z", "amplitude_m": -0.05}
    return scenario_from_table(
        {
            "name": "mixed",
            "duration_s": 2.0,
            "platform": [
                {"foot": "left", "motion": [sine, drop]},
                {"foot": "right", "motion": [ramp("roll", -9.0), ramp("pitch", 12.0)]},
            ],
            "push": [
                {
                    "body": "torso",
                    "force_n": [30.0, 40.0, 5.0],
                    "start_s": 1.0,
                    "duration_s": 0.1,
                }
            ],
        },
        source="test",
    )


def test_every_plain_path_takes_its_own_value_back(scenario: Scenario) -> None:
    plain = {
        "friction": scenario.friction,
        "platform.0.motion.0.frequency_hz": 1.0,
        "platform.1.motion.1.rate_deg_s": 10.0,
        "push.0.force_n": [30.0, 40.0, 5.0],
        "push.0.force_n.1": 40.0,
        "delay.sensor_ms": 0.0,
    }
    assert set(plain) <= set(scenario_paths(scenario))
    assert override_scenario(scenario, plain) == scenario


def test_a_key_without_a_value_takes_one(scenario: Scenario) -> None:
    path = "platform.0.motion.0.blend_s"
    assert override_scenario(scenario, {path: 0.5}).platform[0].motion[0].blend_s == 0.5
    with pytest.raises(FileFormatError, match="no such value"):
        override_scenario(scenario, {"platform.0.motion.9.blend_s": 0.5})


def test_a_value_for_all_becomes_one_for_each(scenario: Scenario) -> None:
    changed = override_scenario(
        scenario,
        {
            "sensors.force_bias_n": 2.0,
            "sensors.force_bias_n.left.2": -30.0,
            "sensors.accel_bias_m_s2.2": 0.03,
            "delay.sensor_ms.force_torque": 2.0,
            "sensors.encoder_offset_rad.left_knee": 0.02,
            "sensors.imu_rate_hz": 200.0,
        },
    )
    assert changed.sensors.axes("force_bias_n", "left") == [2.0, 2.0, -30.0]
    assert changed.sensors.axes("accel_bias_m_s2", None) == [0.0, 0.0, 0.03]
    assert changed.sensors.axes("force_bias_n", "right") == [2.0] * 3
    assert changed.delay.of("force_torque") == 2.0
    assert changed.delay.of("imu") == 0.0
    assert changed.sensors.encoder_offset_rad == {"left_knee": 0.02}
    assert changed.sensors.imu_rate_hz == 200.0


def test_override_changes_one_value_and_never_the_original(scenario: Scenario) -> None:
    changed = override_scenario(scenario, {"model_error.mass_scale": 1.1})
    assert changed.model_error.mass_scale == 1.1
    assert scenario.model_error.mass_scale == 1.0
    back = override_scenario(changed, {"model_error.mass_scale": 1.0})
    assert back == scenario


@pytest.mark.parametrize("direction_deg", [0.0, 45.0, 90.0, 225.0])
def test_push_turns_about_the_vertical_at_constant_impulse(
    scenario: Scenario, direction_deg: float
) -> None:
    x, y, z = (
        override_scenario(scenario, {"push.0.direction_deg": direction_deg})
        .push[0]
        .force_n
    )
    assert math.hypot(x, y) == pytest.approx(50.0)
    assert math.degrees(math.atan2(y, x)) % 360.0 == pytest.approx(direction_deg)
    assert z == 5.0


def test_impulse_is_force_times_duration(scenario: Scenario) -> None:
    (push,) = override_scenario(scenario, {"push.0.impulse_n_s": 20.0}).push
    assert math.hypot(*push.force_n) * push.duration_s == pytest.approx(20.0)
    assert push.force_n[1] / push.force_n[0] == pytest.approx(4.0 / 3.0)


def test_peak_rate_is_that_of_the_sine(scenario: Scenario) -> None:
    path = "platform.0.motion.0.peak_rate_deg_s"
    sine = override_scenario(scenario, {path: 120.0}).platform[0].motion[0]
    assert isinstance(sine, SineMotion)
    peak = math.tau * sine.frequency_hz * sine.amplitude
    assert math.degrees(peak) == pytest.approx(120.0)
    assert sine.amplitude_deg == 8.6


def test_ramps_about_a_diagonal_share_the_rate_and_end_together(
    scenario: Scenario,
) -> None:
    changed = override_scenario(scenario, {"tilt_rate_deg_s": 60.0})
    roll, pitch = (motion.rate for motion in changed.platform[1].motion)  # type: ignore[union-attr]
    assert math.degrees(math.hypot(roll, pitch)) == pytest.approx(60.0)
    assert roll / 9.0 == pytest.approx(pitch / 12.0)


def test_pace_multiplies_rates_and_leaves_a_free_fall_free(scenario: Scenario) -> None:
    changed = override_scenario(scenario, {"pace": 4.0})
    assert changed.platform[0].motion[0].frequency_hz == 4.0  # type: ignore[union-attr]
    assert changed.platform[0].motion[1] == scenario.platform[0].motion[1]
    assert changed.platform[1].motion[0].rate_deg_s == 40.0  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("path", "near"),
    [
        ("frction", "friction"),
        ("platform.0.motion.0.frequency", "platform.0.motion.0.frequency_hz"),
        ("platform.1.motion.1.rate_deg", "platform.1.motion.1.rate_deg_s"),
        ("push.0.direction", "push.0.direction_deg"),
    ],
)
def test_unknown_path_is_refused_with_the_nearest(
    scenario: Scenario, path: str, near: str
) -> None:
    with pytest.raises(FileFormatError, match="no such value") as error:
        override_scenario(scenario, {path: 1.0})
    assert path in str(error.value)
    assert f"did you mean '{near}'?" in str(error.value)


@pytest.mark.parametrize("path", ["name", "push.1.force_n", "platform.0.motion.2"])
def test_path_that_is_not_there_is_refused(scenario: Scenario, path: str) -> None:
    with pytest.raises(FileFormatError, match="no such value"):
        override_scenario(scenario, {path: 1.0})


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("friction", "slippery"),
        ("friction", -0.1),
        ("duration_s", math.nan),
        ("pace", 0.0),
        ("tilt_rate_deg_s", -5.0),
        ("platform.0.motion.0.peak_rate_deg_s", True),
        ("push.0.force_n", [1.0, 2.0]),
    ],
)
def test_bad_value_is_refused_with_its_path(
    scenario: Scenario, path: str, value: object
) -> None:
    with pytest.raises(FileFormatError) as error:
        override_scenario(scenario, {path: value})
    assert path in str(error.value)


def test_values_are_written_as_in_toml() -> None:
    assert parse_override("a.b = [1, 2.5]", option="--x") == ("a.b", [1, 2.5])
    assert parse_override("push.0.body=torso", option="--x") == ("push.0.body", "torso")
    for text in ("friction", "=3", "friction=[1,"):
        with pytest.raises(FileFormatError, match="--x"):
            parse_override(text, option="--x")
