"""A headless Chromium, if there is one."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from typing import Any

import pytest

from tests.support import PATIENCE_S

FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    # No window has the focus: Chromium would give the page's process what others leave.
    "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows",
    "--disable-background-timer-throttling",
)
SIZE = {"width": 640, "height": 480}
"""A small picture: a software renderer takes long for each pixel."""
PAGE_READY_MS = 1000.0 * PATIENCE_S
"""Without a graphics card drawing takes seconds, and minutes on a busy machine."""


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Skip the test, with a message, without the browser."""
    path = shutil.which("chromium") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no chromium; on Debian and Ubuntu: apt-get install chromium")
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="needs playwright: pip install -e .[dev]"
    )
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=list(FLAGS))
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def page(chromium: Any) -> Iterator[Any]:
    """Return a page; ``page.strangers`` lists its requests to other hosts."""
    page = chromium.new_page(viewport=SIZE)
    page.set_default_timeout(PAGE_READY_MS)
    page.strangers = []
    local = ("http://127.0.0.1:", "ws://127.0.0.1:", "file:", "data:", "blob:")

    def note(request: Any) -> None:
        if not request.url.startswith(local):
            page.strangers.append(request.url)

    page.on("request", note)
    yield page
    page.close()
