"""Settings that contradict each other are refused, and both are named."""

from __future__ import annotations

import pytest

from surefoot.robot_io.robot import Robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import build_settings
from surefoot.stabilizer.factory import check_settings


@pytest.mark.parametrize(
    ("override", "other"),
    [
        ("contact.lost_below_n=40", "`regained_above_n`, 40"),
        ("contact.search_force_n=40", "`regained_above_n`, 40"),
        ("safety.overload_n=12000", "12000"),
        ("safety.unloaded_n=1500", "1500"),
    ],
)
def test_within_a_section_when_it_is_read(override: str, other: str) -> None:
    with pytest.raises(
        FileFormatError, match=override.split("=")[0].split(".")[0]
    ) as e:
        build_settings({}, overrides=[override])
    assert other in str(e.value)


@pytest.mark.parametrize(
    ("override", "other"),
    [
        ("tsid.normal_force_max_weights=0.02", "normal_force_max_weights"),
        ("tsid.normal_force_min_n=400", "half the robot's weight"),
        ("zmp.min_ds_pressure_n=400", "half the robot's weight"),
        ("zmp.touchdown_force_n=40", "contact.regained_above_n"),
        ("dik.limit_margin_rad=0.9", "range of every joint"),
        ("estimator.calibration_s=2", "run of 2 s"),
    ],
)
def test_against_the_robot_and_the_run(
    walker: Robot, override: str, other: str
) -> None:
    settings = build_settings({}, overrides=[override])
    with pytest.raises(FileFormatError, match=other):
        check_settings(settings, walker, duration_s=2.0)


def test_a_run_shorter_than_the_usual_calibration_is_no_contradiction(
    walker: Robot,
) -> None:
    check_settings(build_settings({}, overrides=[]), walker, duration_s=0.1)


def test_defaults_and_a_calibration_within_the_run_are_taken(walker: Robot) -> None:
    settings = build_settings({}, overrides=["estimator.calibration_s=1"])
    check_settings(settings, walker, duration_s=2.0)
    check_settings(settings, walker)
