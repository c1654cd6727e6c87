"""Histograms of a loop's times, as table and as JSON."""

from __future__ import annotations

import json
from pathlib import Path

from rich.console import Console

from surefoot.cli.summary import BAR_WIDTH, histogram_table
from surefoot.schemas.result import Histogram
from tests.command import Surefoot

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
    surefoot: Surefoot, short_scenario: Path
) -> None:
    words = ("run", short_scenario, "--controller", "hold", "--json")
    result = json.loads(surefoot(*words, "--histogram").stdout)
    histograms = result["histograms"]
    assert set(histograms) == {"sensors to servos", "round trip", "controller tick"}
    assert sum(histograms["controller tick"]["counts"]) == TICKS
    # The answers to the last ticks come after the last step.
    assert TICKS - 2 <= sum(histograms["sensors to servos"]["counts"]) <= TICKS
    assert result["end_to_end_ms"]["max"] >= result["end_to_end_ms"]["median"] > 0.0
    assert json.loads(surefoot(*words, "--inline").stdout)["histograms"] == {}


def test_the_summary_shows_them(surefoot: Surefoot, short_scenario: Path) -> None:
    done = surefoot("run", short_scenario, "--controller", "hold", "--histogram")
    for words in ("sensors to servos, ", "controller tick, 300 times", "█"):
        assert words in done.stdout
