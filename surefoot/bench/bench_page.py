"""The page of a benchmark, and how all their figures look."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from surefoot.bench.bench_cell import Under
from surefoot.bench.subject import Subject
from surefoot.bench.text_table import TextTable
from surefoot.robot_io.atomic_file import atomic_file
from surefoot.studies.page import inline_svg, render

_LOG = logging.getLogger("surefoot")

TEMPLATE = Path(__file__).parent / "bench.html.j2"
_LINES = ("-", "--", ":", "-.")


def can_draw() -> bool:
    """Whether what a page needs is installed; says so if it is not."""
    missing = [name for name in ("jinja2", "matplotlib") if find_spec(name) is None]
    if missing:
        _LOG.warning("no page: %s is missing; the extra `report`", missing[0])
    return not missing


class Figure(NamedTuple):
    """A drawing.

    Attributes:
        svg: the drawing.
        alt: what it shows, in words.
    """

    svg: bytes
    alt: str

    @property
    def address(self) -> str:
        """Of the drawing, inside the page."""
        return inline_svg(self.svg)


class Section(NamedTuple):
    """A part of the page.

    Attributes:
        title: its heading.
        text: paragraphs.
        figures: drawings.
        tables: after them.
    """

    title: str
    text: Sequence[str]
    figures: Sequence[Figure]
    tables: Sequence[TextTable]


def write_page(
    folder: Path,
    *,
    title: str,
    robot: str,
    subject: Subject,
    intro: Sequence[str],
    sections: Sequence[Section],
    sources: Sequence[str],
) -> None:
    """Write index.html, one static file that opens offline.

    Args:
        folder: that gets it.
        title: its heading.
        robot: as it was given.
        subject: the robot's measures.
        intro: paragraphs before the sections.
        sections: in order.
        sources: where protocols and data come from.
    """
    text = render(
        TEMPLATE,
        title=title,
        robot=robot,
        subject=subject,
        intro=intro,
        sections=sections,
        sources=sources,
    )
    with atomic_file(folder / "index.html") as file:
        file.write(text.encode())


def styles(everyone: Sequence[Under]) -> dict[Under, dict[str, Any]]:
    """Return how each is drawn: a colour a controller, a dash a servo profile."""
    variants = list(dict.fromkeys(under.variant for under in everyone))
    profiles = list(dict.fromkeys(under.servo_profile for under in everyone))
    return {
        under: {
            "color": f"C{variants.index(under.variant)}",
            "linestyle": _LINES[profiles.index(under.servo_profile) % len(_LINES)],
        }
        for under in everyone
    }


def svg_of(figure: Any) -> bytes:
    """Return a matplotlib figure as SVG, the same bytes for the same drawing."""
    import matplotlib as mpl

    buffer = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "surefoot"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()
