"""Wrong options and files end with exit code 2, before anything is started."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command import Surefoot


@pytest.fixture
def surefoot(surefoot_here: Surefoot) -> Surefoot:
    return surefoot_here


def refused(surefoot: Surefoot, *arguments: object) -> str:
    """What a command says when it refuses its options."""
    done = surefoot(*arguments)
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.mark.parametrize("command", ["run", "robot"])
def test_unknown_scenarios_list_the_shipped_ones(
    surefoot: Surefoot, command: str
) -> None:
    words = refused(surefoot, command, "dancing")
    assert "no scenario named 'dancing'" in words
    assert "moving-platform-slow" in words


@pytest.mark.parametrize("command", ["run", "robot"])
def test_a_missing_scenario_file_is_named(surefoot: Surefoot, command: str) -> None:
    assert "gone.toml: no such scenario file" in refused(surefoot, command, "gone.toml")


def test_a_wrong_scenario_key_is_named_by_file_and_path(
    surefoot: Surefoot, tmp_path: Path
) -> None:
    path = tmp_path / "bad.toml"
    path.write_text('name = "x"\nduration_s = 1.0\n[sensors]\nforce_noise = 1.0\n')
    words = refused(surefoot, "run", path)
    assert f"{path}: sensors.force_noise" in words
    assert "did you mean 'force_noise_n'" in words


@pytest.mark.parametrize("command", [["run", "standing"], ["stabilizer"]])
def test_unknown_settings_suggest_the_nearest(
    surefoot: Surefoot, command: list[str]
) -> None:
    words = refused(surefoot, *command, "--set", "tsid.base_kpp=100")
    assert "tsid.base_kpp" in words
    assert "did you mean 'tsid.base_kp'" in words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tsid.base_kp", "expected KEY=VALUE"),
        ("tsid.base_kp=stiff", "tsid.base_kp"),
        ("tsid.base_kp=-1", "tsid.base_kp"),
        ("tsid.base_kp=nan", "tsid.base_kp"),
    ],
)
def test_wrong_setting_values_are_named(
    surefoot: Surefoot, text: str, words: str
) -> None:
    assert words in refused(surefoot, "run", "standing", "--set", text)


def test_a_wrong_settings_file_is_named(surefoot: Surefoot, tmp_path: Path) -> None:
    path = tmp_path / "gains.toml"
    path.write_text("[tsid]\nbase_k = 1.0\n")
    words = refused(surefoot, "run", "standing", "--settings", path)
    assert f"{path}: tsid.base_k" in words


@pytest.mark.parametrize("command", [["run", "standing"], ["robot"], ["stabilizer"]])
def test_unknown_robots_and_servo_profiles_are_named(
    surefoot: Surefoot, command: list[str]
) -> None:
    assert "shipped are walker" in refused(surefoot, *command, "--robot", "runner")
    if command == ["stabilizer"]:
        return  # the servos are the robot's matter
    words = refused(surefoot, *command, "--servo-profile", "magic")
    assert "servo.profile: got 'magic'" in words
    assert "harmonic, ideal" in words


@pytest.mark.parametrize("command", [["run", "standing"], ["robot"], ["stabilizer"]])
def test_wrong_endpoint_files_are_named(
    surefoot: Surefoot, command: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "endpoints.toml"
    path.write_text('conect = ["tcp/127.0.0.1:7447"]')
    words = refused(surefoot, *command, "--endpoints", path)
    assert f"{path}: conect" in words
    assert "did you mean 'connect'" in words


def test_unknown_controllers_list_the_valid_ones(surefoot: Surefoot) -> None:
    words = refused(surefoot, "run", "standing", "--controller", "magic")
    assert "whole-body" in words
    assert "hold" in words


@pytest.mark.parametrize(
    "extra", [["--realtime"], ["--listen", "tcp/127.0.0.1:0"], ["--connect", "tcp/a:1"]]
)
def test_inline_goes_without_bus_and_real_time(
    surefoot: Surefoot, extra: list[str]
) -> None:
    words = refused(surefoot, "run", "standing", "--inline", *extra)
    assert "--inline" in words
    assert extra[0] in words


@pytest.mark.parametrize(
    "words", [("run", "standing"), ("robot", "standing"), ("stabilizer",)]
)
def test_a_loop_that_never_rests_takes_no_real_time_priority(
    surefoot: Surefoot, words: tuple[str, ...]
) -> None:
    told = refused(surefoot, *words, "--realtime-priority", "20")
    assert "--realtime-priority goes with --realtime" in told


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize(
    "option",
    ["velocity", "lateral", "yaw-rate", "step-s", "double-s", "height", "wait"],
)
def test_a_walk_by_numbers_that_are_none_is_refused(
    surefoot: Surefoot, option: str, value: str
) -> None:
    words = refused(surefoot, "walk", f"--{option}={value}")
    assert f"Invalid value for '--{option}'" in words
