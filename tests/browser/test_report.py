"""A report in a real browser, from its files, without a network."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.browser.conftest import PAGE_READY_MS
from tests.browser.pictures import pixels_changed
from tests.support import wait_until
from tests.surefoot.report.runs import shared_page

MOVED_PIXELS = 60
PANELS = 20
"""Least number of plots of a run in which one axis of the ground moves."""
FIRST_S, LATER_S = 0.2, 1.2
"""Times at which the ground is still at rest, and has heaved [s]."""
SMALL = {"width": 400, "height": 300}
"""A small picture, which is drawn faster."""
LEGS = {"x": 130, "y": 170, "width": 140, "height": 80}
"""Place of the legs in the small picture, below the page's notes on drawing."""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, chromium: Any) -> Path:
    del chromium  # without a browser nothing is made
    return shared_page(tmp_path_factory)


@pytest.fixture(scope="module")
def offline(chromium: Any) -> Iterator[Any]:
    """Return a context without network; ``complaints`` holds errors of its pages."""
    context = chromium.new_context(
        viewport={"width": 1200, "height": 800}, offline=True
    )
    context.set_default_timeout(PAGE_READY_MS)
    context.complaints = []
    context.on("weberror", lambda error: context.complaints.append(str(error.error)))
    context.on(
        "console",
        lambda message: (
            context.complaints.append(message.text) if message.type == "error" else None
        ),
    )
    context.strangers = []

    def note(request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:")):
            context.strangers.append(request.url)

    context.on("request", note)
    yield context
    context.close()


@pytest.fixture(scope="module")
def plots(offline: Any, report: Path) -> Any:
    """Return the page without its scenes, which have tests of their own."""
    page = offline.new_page()
    # Two scenes drawn by a processor would take all of it while plots are looked at.
    page.route("**/scene-*.html", lambda route: route.fulfill(body="scene"))
    page.goto((report / "index.html").as_uri())
    yield page
    page.close()


def test_paper_shows_every_plot(offline: Any, report: Path) -> None:
    page = offline.new_page()
    page.route("**/scene-*.html", lambda route: route.fulfill(body="scene"))
    page.goto((report / "index.html").as_uri())
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    drawn = page.locator("[data-panel][data-drawn]").count
    assert page.locator("[data-panel]").count() >= PANELS
    wait_until(
        lambda: drawn() == page.locator("[data-panel]").count(), what="every plot"
    )
    page.close()


def test_an_axis_of_words_is_named_beside_them(plots: Any) -> None:
    panel = plots.locator("[data-panel=state]")
    panel.scroll_into_view_if_needed()
    wait_until(partial(panel.get_attribute, "data-drawn"), what="the plot")
    name = panel.locator(".ytitle").bounding_box()
    words = [word.bounding_box() for word in panel.locator(".ytick text").all()]
    assert len(words) > 1
    assert all(name["x"] + name["width"] <= word["x"] for word in words)


def test_every_plot_is_drawn_when_it_comes_into_view(plots: Any) -> None:
    panels = plots.locator("[data-panel]")
    assert panels.count() >= PANELS
    for index in range(panels.count()):
        panel = panels.nth(index)
        panel.scroll_into_view_if_needed()
        wait_until(
            partial(panel.get_attribute, "data-drawn"),
            what=f"plot {index}",
        )
        lengths = panel.locator(".scatterlayer path.js-line").evaluate_all(
            "lines => lines.map(line => line.getTotalLength())"
        )
        assert len(lengths) >= 2
        assert min(lengths) > 0.0


def test_no_button_of_a_plot_covers_its_legend_or_its_curves(plots: Any) -> None:
    panel = plots.locator("[data-panel]").first
    panel.scroll_into_view_if_needed()
    wait_until(partial(panel.get_attribute, "data-drawn"), what="the first plot")
    covered = plots.evaluate(
        """() => [...document.querySelectorAll('[data-drawn]')].flatMap(panel => {
          const buttons = panel.querySelector('.modebar').getBoundingClientRect();
          const meets = (other) =>
            other.left < buttons.right && other.right > buttons.left &&
            other.top < buttons.bottom && other.bottom > buttons.top;
          return [...panel.querySelectorAll('.legendtext, .plot')]
            .filter(part => meets(part.getBoundingClientRect()))
            .map(part => `${panel.dataset.panel}: ${part.textContent}`);
        })"""
    )
    assert covered == []


def test_all_time_axes_follow_a_zoom(plots: Any) -> None:
    plots.evaluate(
        "Plotly.relayout(document.querySelector('[data-panel=com_x]'),"
        "  {'xaxis.range[0]': 0.25, 'xaxis.range[1]': 0.75})"
    )
    ranges = (
        "[...document.querySelectorAll('[data-panel]')]"
        ".map(panel => panel.layout.xaxis.range.join(' '))"
    )
    wait_until(
        lambda: set(plots.evaluate(ranges)) == {"0.25 0.75"},
        what="all plots to follow",
    )
    plots.get_by_role("button", name="whole run").click()
    wait_until(
        lambda: set(plots.evaluate(ranges)) == {"0 1.499"},
        what="the whole run",
    )


def test_a_run_can_be_hidden_everywhere(plots: Any) -> None:
    shown = (
        "[...document.querySelectorAll('[data-panel]')].flatMap("
        "panel => panel.data.filter(line => line.visible !== false)"
        ".map(line => line.name.split(',')[0]))"
    )
    assert set(plots.evaluate(shown)) == {"bus", "zmp"}
    plots.get_by_label("zmp", exact=True).uncheck()
    wait_until(
        lambda: set(plots.evaluate(shown)) == {"bus"},
        what="the other run's curves only",
    )


def test_the_scene_plays(offline: Any, report: Path) -> None:
    page = offline.new_page()
    page.set_viewport_size(SMALL)
    page.goto((report / "scene-1.html").as_uri())
    page.locator("canvas[data-engine]").wait_for()
    time_shown = page.locator("input").first
    first_time = time_shown.input_value()
    wait_until(
        lambda: time_shown.input_value() != first_time,
        what="the play bar to move",
    )

    def show(moment_s: float) -> None:
        time_shown.fill(f"{moment_s}")
        time_shown.press("Enter")

    # Stopped, it is drawn once for each moment asked for: no race with the film.
    page.locator("button:not([aria-label]):has(svg)").last.click()
    show(FIRST_S)
    first = page.screenshot(clip=LEGS)
    show(LATER_S)
    wait_until(
        lambda: pixels_changed(page, first, page.screenshot(clip=LEGS)) > MOVED_PIXELS,
        what="the robot to move",
    )
    page.close()


def test_nothing_was_asked_for_and_nothing_complained(offline: Any) -> None:
    assert offline.strangers == []
    assert offline.complaints == []
