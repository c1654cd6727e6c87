"""A walk from the live page does not begin after stop was pressed."""

from __future__ import annotations

import pytest

from surefoot.robot_io.robot import load_robot
from surefoot.schemas.endpoints import Endpoints
from surefoot.view import walk
from surefoot.view.walk import Stroller

RATES = (0.1, 0.0, 0.0)


def test_a_stop_counts_more_than_a_walk_that_was_asked_for_before(
    monkeypatch: pytest.MonkeyPatch, endpoints: Endpoints
) -> None:
    monkeypatch.setattr(walk, "DIAL_S", 0.05)
    told: list[str] = []
    stroller = Stroller(load_robot("walker"), endpoints, tell=told.append)
    asked = stroller.stops
    stroller.stop()
    stroller.go(RATES, since=asked)
    assert not stroller.is_walking
    assert told == []
    stroller.go(RATES, since=stroller.stops)
    stroller.stop()
    stroller.go(RATES, since=asked)  # waits for the walk before
    assert not stroller.is_walking
    (word,) = told
    assert word.startswith("walk: nobody answers")
