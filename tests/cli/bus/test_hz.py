from __future__ import annotations

import json

from surefoot.schemas.endpoints import Endpoints
from tests.cli.bus.conftest import Ask
from tests.cli.bus.talking_robot import Say, force_torque, talking_robot

SPAN = 10


def say(count: int, tell: Say) -> None:
    """Publish ticks; one of ten is missing, one comes twice, one comes late."""
    span, at = divmod(count, SPAN)
    order = [0, 1, 2, 2, 4, 3, 5, 6, 7, 9]  # the 8 is missing
    tell("state/ft/left_ankle", force_torque(SPAN * span + order[at]))
    if at == 0:
        tell("state/ft/right_ankle", b"nonsense")


def test_gaps_doubles_and_late_ones_as_often_as_they_are(
    ask: Ask, endpoints: Endpoints
) -> None:
    with talking_robot(endpoints, say):
        done = ask("hz", "left_ankle_ft", "right_ankle_ft", "--for", 1.5, "--json")
    left, right = json.loads(done.stdout)
    spans = left["messages"] / SPAN
    assert spans > 2
    # A late 3 was passed over before, as a gap, and the 8 never comes.
    for name, each in (("gaps", 2), ("duplicates", 1), ("out_of_order", 1)):
        assert abs(left[name] - each * spans) <= each + 1, name
    assert left["unreadable"] == 0
    assert left["rate_hz"] > 0
    # One clock: both are on this host.
    assert 0.0 < left["delay_ms"]["median"] <= left["delay_ms"]["p99"]
    assert right["unreadable"] == right["messages"] > 0
    assert right["rate_hz"] is None


def test_a_pipe_gets_one_table_and_no_escapes(ask: Ask, endpoints: Endpoints) -> None:
    with talking_robot(endpoints, say):
        done = ask("hz", "--for", 0.3)
    assert done.stdout.count("left_ankle_ft") == 1
    assert "\x1b" not in done.stdout + done.stderr
    assert "joints" in done.stdout  # all channels, also silent ones
