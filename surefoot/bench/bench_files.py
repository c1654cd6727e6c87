"""Files and pages that all benches write: EUROBENCH's YAML, tables, page frames."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from surefoot.bench.bench_runs import Subject, Under
from surefoot.robot_io.atomic_file import atomic_file
from surefoot.studies.paper_page import inline_svg, render

Number = float | int | None
NONE = "-"
_LINES = ("-", "--", ":", "-.")


def write_scalar(path: Path, value: Number, *, label: str) -> None:
    """Write one figure.

    Args:
        path: of the file.
        value: None for what could not be told.
        label: what it is, with its unit.
    """
    _write(path, "scalar", json.dumps(label), _number(value))


def write_vector(
    path: Path, values: Sequence[Number], *, labels: Sequence[str]
) -> None:
    """Write figures that belong together.

    Args:
        path: of the file.
        values: None for what could not be told.
        labels: of each, with its unit.
    """
    numbers = ", ".join(map(_number, values))
    _write(path, "vector", json.dumps(list(labels)), f"[{numbers}]")


def _number(value: Number) -> str:
    if value is None or not math.isfinite(value):
        return ".nan"
    # YAML 1.1 takes 1e-05 for a text: a number needs a point before the exponent.
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return text if not e or "." in mantissa else f"{mantissa}.0e{exponent}"


def _write(path: Path, kind: str, label: str, value: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as file:
        file.write(f"type: {kind}\nlabel: {label}\nvalue: {value}\n".encode())


class TextTable(NamedTuple):
    """A table of texts.

    Attributes:
        title: what it shows.
        columns: headings.
        rows: a text for each heading.
    """

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """Return it as a Markdown table under its title."""
        lines = [
            "| " + " | ".join(self.columns) + " |",
            "|" + "---|" * len(self.columns),
            *("| " + " | ".join(row) + " |" for row in self.rows),
        ]
        return f"### {self.title}\n\n" + "\n".join(lines) + "\n"


def text(value: float | None, form: str) -> str:
    """Return a number as text; a dash for none."""
    return NONE if value is None else format(value, form)


_LOG = logging.getLogger("surefoot")

TEMPLATE = Path(__file__).parent / "bench.html.j2"


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
