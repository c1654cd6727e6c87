"""Valid user files load; others are refused by file and key."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.motions import DropMotion, RampMotion, SineMotion
from surefoot.schemas.scenario import Scenario, load_scenario
from surefoot.schemas.toml_file import find_toml

HEAD = """
name = "test"
duration_s = 12.0
"""
PLATFORM = (
    HEAD
    + """
[[platform]]
foot = "left"
"""
)
GOOD = (
    PLATFORM
    + """
  [[platform.motion]]
  axis = "roll"
  kind = "sine"
  amplitude_deg = 8.6
  frequency_hz = 0.175
  phase_deg = 90
  start_s = 1.0
  [[platform.motion]]
  axis = "z"
  kind = "drop"
  amplitude_m = -0.08
  [[platform.motion]]
  axis = "pitch"
  kind = "ramp"
  amplitude_deg = -15.0
  rate_deg_s = 240.0
[[push]]
body = "torso"
force_n = [0, 120.0, 0]
start_s = 3.0
duration_s = 0.1
[sensors]
force_noise_n = 2.0
[delay]
command_ms = 2
[model_error]
mass_scale = 1.05
"""
)


def motion(text: str) -> str:
    lines = "\n  ".join(text.strip().splitlines())
    return f"{PLATFORM}  [[platform.motion]]\n  {lines}\n"


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    return tmp_path / "scenario.toml"


def refused(path: Path, text: str) -> FileFormatError:
    """Return the refusal of a scenario, which must name file and key."""
    path.write_text(text)
    with pytest.raises(FileFormatError) as caught:
        load_scenario(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert caught.value.field in str(caught.value)
    return caught.value


def test_a_full_scenario_loads(scenario_file: Path) -> None:
    scenario_file.write_text(GOOD)
    scenario = load_scenario(scenario_file)
    sine, drop, ramp = scenario.platform[0].motion
    assert isinstance(sine, SineMotion)
    assert sine.amplitude == pytest.approx(math.radians(8.6))
    assert isinstance(drop, DropMotion)
    assert (drop.amplitude, drop.rate) == (-0.08, None)
    assert isinstance(ramp, RampMotion)
    assert ramp.amplitude == pytest.approx(math.radians(-15.0))
    assert ramp.rate == pytest.approx(math.radians(240.0))
    assert scenario.push[0].force_n == [0.0, 120.0, 0.0]
    assert scenario.delay.command_ms == 2.0
    assert scenario.sensors.gyro_noise_rad_s == 0.0


def test_name_and_duration_are_enough(scenario_file: Path) -> None:
    scenario_file.write_text(HEAD)
    assert load_scenario(scenario_file) == Scenario(name="test", duration_s=12.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# mine", "name: is missing, and so is duration_s"),
        (HEAD + "friction = 1e300", "friction: got 1e+300"),
        (HEAD + "platform = 3", "platform: got 3, expected a list of tables"),
        (
            HEAD + "[[push]]\nbody = 'torso'\nforce_n = 'far'",
            "push[0].force_n: got 'far', expected a list of 3 numbers",
        ),
        (HEAD + "[platform]\nfoot = 'left'", "list of tables: write [[platform]]"),
        (HEAD + "FRICTION = 0.5", "FRICTION: no such key; did you mean 'friction'?"),
        (motion('axis = "rol"\nkind = "sine"'), "'z'; did you mean 'roll'?"),
        (motion('axis = "z"\nkind = "jump"'), "got 'jump', expected one of 'sine', "),
        (motion('axis = "z"'), "is missing, expected one of 'sine', 'ramp', 'drop'"),
        (HEAD + "[[platform]]\nfoot = 'lefft'", "'lefft', expected one of 'both', 'le"),
        ("name = 'x'\nduration_s = 0", "got 0, expected a number > 0.0"),
        ("name = 'x'\nduration_s = 'long'", "got 'long', expected a number"),
        (HEAD + f"[sensors]\nforce_noise_n = {10**15}", "at most 1e+12"),
    ],
)
def test_a_refusal_says_what_was_expected(
    scenario_file: Path, text: str, words: str
) -> None:
    assert words in str(refused(scenario_file, text))


def test_no_refusal_offers_what_toml_has_not(scenario_file: Path) -> None:
    said = str(refused(scenario_file, HEAD + "[delay]\ncommand_ms = 'late'"))
    assert said.endswith("delay.command_ms: got 'late', expected a number")


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("duration_s = 1.0", "name"),
        (HEAD + "friction = 0.0", "friction"),
        (HEAD + "friction = nan", "friction"),
        (HEAD + "friction = true", "friction"),
        (HEAD + 'friction = "0.7"', "friction"),
        ('name = "x"\nduration_s = inf', "duration_s"),
        ('name = "x"\nduration_s = 1e9', "duration_s"),
        (motion('axis = "up"\nkind = "sine"'), "platform[0].motion[0].axis"),
        (motion('axis = "z"\nkind = "jump"'), "platform[0].motion[0].kind"),
        (
            motion('axis = "z"\nkind = "sine"\namplitude_m = 1'),
            "platform[0].motion[0].frequency_hz",
        ),
        (
            motion('axis = "z"\nkind = "sine"\namplitude_m = nan\nfrequency_hz = 1'),
            "platform[0].motion[0].amplitude_m",
        ),
        (
            motion('axis = "z"\nkind = "sine"\namplitude_m = 60\nfrequency_hz = 1'),
            "platform[0].motion[0].amplitude_m",
        ),
        (HEAD + "[sensors]\nforce_noise_n = -1", "sensors.force_noise_n"),
        (HEAD + "[delay]\ncommand_ms = -1", "delay.command_ms"),
        (HEAD + "[model_error]\nmass_scale = 0.001", "model_error.mass_scale"),
        (HEAD + "[model_error]\nbacklash_rad = 2", "model_error.backlash_rad"),
        (
            HEAD + "[sensors]\nencoder_resolution_rad = 0.5",
            "sensors.encoder_resolution_rad",
        ),
        (HEAD + "[[push]]\nbody = 'torso'\nforce_n = [1, 2]", "push[0].force_n"),
    ],
)
def test_wrong_values_are_named_by_file_and_key(
    scenario_file: Path, text: str, field: str
) -> None:
    assert refused(scenario_file, text).field == field


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            'axis = "roll"\nkind = "sine"\namplitude_m = 1\nfrequency_hz = 1',
            "takes `amplitude_deg`, got `amplitude_m`",
        ),
        ('axis = "x"\nkind = "sine"\nfrequency_hz = 1', "needs `amplitude_m`"),
        ('axis = "x"\nkind = "ramp"\namplitude_m = 1', "needs `rate_m_s`"),
        ('axis = "yaw"\nkind = "drop"\namplitude_deg = 1', "needs `rate_deg_s`"),
        (
            'axis = "z"\nkind = "drop"\namplitude_m = 1\nrate_deg_s = 1',
            "takes `rate_m_s`, got `rate_deg_s`",
        ),
    ],
)
def test_units_must_fit_the_axis(scenario_file: Path, text: str, words: str) -> None:
    error = refused(scenario_file, motion(text))
    assert words in str(error)
    assert error.field == "platform[0].motion[0]"


def test_a_foot_has_one_platform(scenario_file: Path) -> None:
    text = PLATFORM + '[[platform]]\nfoot = "both"\n'
    assert "left foot has 2 platforms" in str(refused(scenario_file, text))


@pytest.mark.parametrize(
    ("text", "field", "hint"),
    [
        (HEAD + "fricton = 1", "fricton", "did you mean 'friction'?"),
        (HEAD + "[sensors]\nforce_noise = 1", "sensors.force_noise", "force_noise_n"),
        (
            motion('kind = "sine"\naxis = "x"\nfrequency_hz = 1\namplitude_mm = 1'),
            "platform[0].motion[0].amplitude_mm",
            "did you mean 'amplitude_m'?",
        ),
        (HEAD + "wind = 3", "wind", "valid are delay, description, duration_s"),
        (HEAD + "[delay]\nsensor_noise = 1", "delay.sensor_noise", "'sensor_ms'"),
    ],
)
def test_unknown_keys_get_a_hint_from_their_own_table(
    scenario_file: Path, text: str, field: str, hint: str
) -> None:
    error = refused(scenario_file, text)
    assert error.field == field
    assert "no such key" in str(error)
    assert hint in str(error)


def test_missing_and_broken_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"absent\.toml: no such file"):
        load_scenario(tmp_path / "absent.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("name = ")
    with pytest.raises(FileFormatError, match=r"is a folder.*holds broken\.toml"):
        load_scenario(tmp_path)
    with pytest.raises(FileFormatError, match=r"got a folder; it holds broken\.toml"):
        find_toml(tmp_path, {}, what="scenario", error=FileFormatError)
    with pytest.raises(FileFormatError, match=r"broken\.toml: not valid TOML"):
        load_scenario(broken)
    broken.write_bytes(b"\xff\xfe")
    with pytest.raises(FileFormatError, match="is no text"):
        load_scenario(broken)
