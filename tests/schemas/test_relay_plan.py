"""Valid relay plans load; others are refused by file and key."""

from __future__ import annotations

from pathlib import Path

import pytest

from surefoot.robot_io.relay.relay import find_plan, list_plans
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.relay_plan import RelayPlan, load_relay_plan
from surefoot.schemas.toml_file import convert
from surefoot.schemas.topics import TOPICS

SHIPPED = {
    "clear",
    "loss-5",
    "jitter-5ms",
    "delay-10ms",
    "delay-10ms-both-ways",
    "cut-200ms",
    "duplicated",
    "reordered",
    "corrupted",
    "clock-jump",
}


def refusal(tmp_path: Path, text: str) -> str:
    """Return the refusal of a plan with this fault."""
    path = tmp_path / "plan.toml"
    path.write_text(f'name = "test"\n[[fault]]\n{text}\n')
    with pytest.raises(FileFormatError) as caught:
        load_relay_plan(path)
    assert str(caught.value).startswith(f"{path}: fault[0]")
    return str(caught.value)


def test_the_shipped_plans_are_there() -> None:
    assert set(list_plans()) == SHIPPED


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_every_shipped_plan_loads_and_says_what_it_does(name: str) -> None:
    plan = load_relay_plan(find_plan(name))
    assert plan.description
    assert bool(plan.fault) == (name != "clear")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('kind = "drop"\nprobability = 0.1', "either `topics` or `direction`"),
        (
            'kind = "drop"\nprobability = 0.1\ndirection = "all"\ntopics = ["imu"]',
            "either `topics` or `direction`",
        ),
        (
            'kind = "drop"\nprobability = 0.1\ntopics = ["joint"]',
            "no channel 'joint'; did you mean 'joints'?",
        ),
        ('kind = "drop"\nprobability = 0.1\ntopics = ["xyz"]', "valid are control"),
        ('kind = "drop"\ndirection = "all"\nprobabilty = 0.1', "probabil"),
        ('kind = "drop"\ndirection = "all"\nprobability = 1.5', "probability"),
        ('kind = "drop"\ndirection = "all"\nprobability = nan', "finite"),
        ('kind = "delay"\ndirection = "all"\nms = -1.0', "ms"),
        ('kind = "delay"\ndirection = "everything"\nms = 1.0', "direction"),
        ('kind = "lose"\ndirection = "all"', "lose"),
        ('kind = "cut"\ndirection = "all"\nstart_s = 5.0', "needs `duration_s`"),
        (
            'kind = "clock_jump"\ntopics = ["lease"]\nseconds = 1.0',
            "'lease' carries has no stamp",
        ),
    ],
)
def test_mistakes_are_named(tmp_path: Path, text: str, words: str) -> None:
    assert words in refusal(tmp_path, text)


def test_an_unknown_key_is_answered_with_the_nearest(tmp_path: Path) -> None:
    text = 'kind = "jitter"\ndirection = "all"\nms = 5.0\nstart = 1.0'
    words = refusal(tmp_path, text)
    assert "fault[0].start: no such key" in words
    assert "did you mean 'start_s'?" in words


@pytest.mark.parametrize(("name", "near"), [("loss5", "loss-5"), ("cut", "cut-200ms")])
def test_an_unknown_plan_is_answered_with_the_shipped_ones(
    name: str, near: str
) -> None:
    with pytest.raises(FileFormatError) as caught:
        find_plan(name)
    assert f"no relay plan named '{name}'" in str(caught.value)
    assert near in str(caught.value)


def test_a_missing_plan_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"gone\.toml: no such relay plan"):
        find_plan(str(tmp_path / "gone.toml"))


def test_directions_mean_all_the_robot_says_and_the_commands() -> None:
    def channels(direction: str) -> set[str]:
        fault = {"kind": "delay", "ms": 1.0, "direction": direction}
        plan = convert({"name": "x", "fault": [fault]}, RelayPlan, source="test")
        return set(plan.fault[0].channels)

    assert channels("commands") == {"joint_command"}
    assert {"joints", "imu", "status"} <= channels("sensors")
    assert channels("all") == channels("sensors") | channels("commands")
    services = {entry.name for entry in TOPICS if "service" in entry.direction}
    assert channels("all").isdisjoint(services)
