"""The documentation in a browser, opened as files: formulas, search, no network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.docs.test_site import build_well
from tests.once import made_once

FONT = "STIX Two Math"
DESKTOP = {"width": 1280, "height": 800}
"""Size of a window; in a narrower one the search is hidden behind a button."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, chromium: Any) -> Path:
    del chromium  # without a browser nothing is built
    return made_once(tmp_path_factory, "site", build_well)


def test_formulas_are_drawn_in_the_font_that_comes_along(page: Any, site: Path) -> None:
    page.goto((site / "controller.html").as_uri())
    page.wait_for_function(f"document.fonts.check('16px \"{FONT}\"')")
    formulas = page.locator("div.math math")
    assert formulas.count() > 5
    for index in range(formulas.count()):
        box = formulas.nth(index).bounding_box()
        assert box["width"] > 50
        assert box["height"] > 15
    # No formula is cut off at this width.
    wide = page.locator("div.math").evaluate_all(
        "boxes => boxes.filter(box => box.scrollWidth > box.clientWidth + 1).length"
    )
    assert wide == 0


def test_a_link_to_a_function_opens_its_line(page: Any, site: Path) -> None:
    page.goto((site / "controller.html").as_uri())
    page.get_by_role("link", name="Tsid.solve", exact=True).first.click()
    page.wait_for_url("**/tsid.py.html#__codelineno-*")
    anchor = page.locator(f"[id='{page.url.split('#')[1]}']")
    assert "def solve" in anchor.evaluate("a => a.parentElement.textContent")


def test_search_finds_a_setting_without_a_server(page: Any, site: Path) -> None:
    page.set_viewport_size(DESKTOP)
    page.goto((site / "index.html").as_uri())
    page.locator("input.md-search__input").click()
    page.locator("input.md-search__input").press_sequentially("windup_limit_rad")
    # What the first letters found goes when the word is whole.
    page.locator(".md-search-result__link[href*='settings']").first.wait_for()


def test_the_pages_ask_nobody_for_anything(page: Any, site: Path) -> None:
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    for name in (
        "index",
        "tutorial",
        "reference/settings",
        "source/stabilizer/control/dik.py",
    ):
        page.goto((site / f"{name}.html").as_uri())
        page.wait_for_load_state("networkidle")
    assert page.strangers == []
    assert errors == []
