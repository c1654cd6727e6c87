"""Histograms of a loop's times, as table and as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rich.console import Console

from surefoot.cli.summary import BAR_WIDTH, histogram_table
from surefoot.schemas.result import Histogram
from tests.command import Surefoot
from tests.once import short_run

TICKS = 300


def shown(histogram: Histogram) -> list[str]:
    console = Console(width=100, record=True, file=None, quiet=False)
    with console.capture() as captured:
        console.print(histogram_table("round trip", histogram))
    return captured.get().splitlines()


def test_bars_are_as_long_as_their_share_and_the_rare_is_not_lost() -> None:
    histogram = Histogram(edges_ms=[1.0, 2.0, 5.0], counts=[1000, 0, 500, 1])
    title, _, *lines = shown(histogram)
    assert title.startswith("round trip, 1501 times")
    under, empty, half, over = lines
    assert under.count("█") == BAR_WIDTH
    assert half.count("█") == BAR_WIDTH // 2
    assert "under 1" in under
    assert "66.62 %" in under
    assert "1 to 2" in empty
    assert "▏" not in empty
    assert "over 5" in over
    assert "▏" in over


def test_nothing_is_shown_beyond_what_was_there() -> None:
    histogram = Histogram(edges_ms=[1.0, 2.0, 5.0], counts=[0, 0, 3, 0])
    assert len(shown(histogram)) == 3  # title, heading, one range


def test_a_run_tells_its_histograms_on_request_only(
    surefoot: Surefoot,
    short_scenario: Path,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    words = ("--controller", "hold", "--histogram", "--out", tmp_path / "run")
    told = surefoot("run", short_scenario, *words).stdout
    for text in ("sensors to servos, ", "controller tick, 300 times", "█"):
        assert text in told
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    histograms = result["histograms"]
    assert set(histograms) == {"sensors to servos", "round trip", "controller tick"}
    assert sum(histograms["controller tick"]["counts"]) == TICKS
    # The answers to the last ticks come after the last step.
    assert TICKS - 2 <= sum(histograms["sensors to servos"]["counts"]) <= TICKS
    assert result["end_to_end_ms"]["max"] >= result["end_to_end_ms"]["median"] > 0.0
    unasked = short_run(tmp_path_factory) / "result.json"
    assert json.loads(unasked.read_text())["histograms"] == {}
