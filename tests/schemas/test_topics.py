from __future__ import annotations

import pytest

from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.topics import TICK_SENSORS, TOPICS, Direction, resolve_keys, topic


def test_names_and_keys_are_unique() -> None:
    assert len({entry.name for entry in TOPICS}) == len(TOPICS)
    assert len({entry.key for entry in TOPICS}) == len(TOPICS)


def test_a_snapshot_is_made_of_what_the_robot_says_every_tick() -> None:
    every_tick = [
        entry.name
        for entry in TOPICS
        if entry.direction is Direction.FROM_ROBOT and entry.rate == "every tick"
    ]
    assert list(TICK_SENSORS) == every_tick


def test_topics_are_found_by_name() -> None:
    assert topic("imu").key == "state/imu"
    with pytest.raises(KeyError, match=r"lidar.*left_ankle_ft"):
        topic("lidar")


def test_overrides_replace_single_keys_without_their_slash() -> None:
    keys = resolve_keys({"left_ankle_ft": "/sensor/ft/lankle"})
    assert keys.pop("left_ankle_ft") == "sensor/ft/lankle"
    default = resolve_keys({})
    default.pop("left_ankle_ft")
    assert keys == default


@pytest.mark.parametrize(
    "key", ["", "/", "a//b", "a/*", "a/**", "a?b", "a#b", "$*", "@a", "a/@b"]
)
def test_keys_that_zenoh_cannot_hold_or_patterns_miss_are_refused(key: str) -> None:
    with pytest.raises(FileFormatError, match="expected a key such as") as caught:
        resolve_keys({"imu": key})
    assert caught.value.field == "keys.imu"


def test_unknown_channels_are_refused_with_the_valid_ones() -> None:
    with pytest.raises(FileFormatError, match=r"no such channel.*joint_command"):
        resolve_keys({"imu2": "a"})


def test_two_channels_cannot_share_a_key() -> None:
    with pytest.raises(FileFormatError, match="also used by joints"):
        resolve_keys({"imu": "state/joints"})
