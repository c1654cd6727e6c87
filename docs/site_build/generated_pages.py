"""Pages of the site that are generated from the code, so they are never out of date."""

from __future__ import annotations

from collections.abc import Callable

from docs.site_build.api_page import api_page
from docs.site_build.bus_page import bus_page
from docs.site_build.commands_page import commands_page
from docs.site_build.file_pages import (
    endpoint_page,
    results_page,
    robot_page,
    scenario_page,
)
from docs.site_build.settings_page import settings_page
from docs.site_build.signals_page import signals_page
from docs.site_build.source_links import ROOT


def changelog_page() -> str:
    """The change log as it stands."""
    return (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


PAGES: dict[str, Callable[[], str]] = {
    "reference/api.md": api_page,
    "reference/commands.md": commands_page,
    "reference/settings.md": settings_page,
    "reference/bus.md": bus_page,
    "reference/signals.md": signals_page,
    "reference/scenario-file.md": scenario_page,
    "reference/robot-file.md": robot_page,
    "reference/endpoint-file.md": endpoint_page,
    "reference/results.md": results_page,
    "changelog.md": changelog_page,
}
"""Page, relative to docs, to the function that writes its Markdown."""
