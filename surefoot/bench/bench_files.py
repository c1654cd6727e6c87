"""Files and pages that all benchmarks write: EUROBENCH's YAML, tables, page frames."""

from __future__ import annotations

import json
import logging
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

from surefoot.bench.bench_runs import Subject, Under
from surefoot.installation import lacking
from surefoot.out_folder import write_json, write_whole
from surefoot.presentation import markdown
from surefoot.studies.paper_page import inline_svg, render

Number = float | int | None
_LINES = ("-", "--", ":", "-.")


_FIRST = "type: "
"""Beginning of each of EUROBENCH's files."""


def write_scalar(path: Path, value: Number, *, label: str) -> None:
    """Write one figure.

    Args:
        path: of the file.
        value: the figure; None if it could not be measured.
        label: its name and unit.
    """
    _write(path, "scalar", json.dumps(label), _number(value))


def write_vector(
    path: Path, values: Sequence[Number], *, labels: Sequence[str]
) -> None:
    """Write figures that belong together.

    Args:
        path: of the file.
        values: the figures; None for one that could not be measured.
        labels: name and unit of each.
    """
    numbers = ", ".join(map(_number, values))
    _write(path, "vector", json.dumps(list(labels)), f"[{numbers}]")


def _number(value: Number) -> str:
    if value is None or not math.isfinite(value):
        return ".nan"
    # YAML 1.1 reads 1e-05 as text: a number needs a point before the exponent.
    text = repr(float(value))
    mantissa, e, exponent = text.partition("e")
    return text if not e or "." in mantissa else f"{mantissa}.0e{exponent}"


def _write(path: Path, kind: str, label: str, value: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    text = f"{_FIRST}{kind}\nlabel: {label}\nvalue: {value}\n"
    write_whole(path, text.encode())


class TextTable(NamedTuple):
    """A table of texts.

    Attributes:
        title: of the table.
        columns: headings.
        rows: a text for each heading.
    """

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """Return it as a Markdown table under its title."""
        return f"### {self.title}\n\n{markdown(self.columns, self.rows)}"


class BenchResult(Protocol):
    """A result of a benchmark."""

    def as_dict(self) -> dict[str, Any]:
        """Return it as built-in types, for JSON."""


R = TypeVar("R", bound=BenchResult)


@dataclass(frozen=True)
class Findings(ABC, Generic[R]):
    """Results of a benchmark.

    Attributes:
        robot: shipped name or path of the robot's file.
        subject: measures of the robot.
        results: in the order in which they were asked for.
        folder: folder of all files; None if nothing is kept.
        asked: further inputs of all runs, such as settings, for JSON.
    """

    NAME: ClassVar[str]
    """Name of the benchmark, as on the command line."""
    robot: str
    subject: Subject
    results: list[R]
    folder: Path | None = None
    asked: Mapping[str, Any] = field(default_factory=dict)

    @property
    def who(self) -> str:
        """The robot and the inputs of its runs, in words."""
        told = [f"{name} {json.dumps(v)}" for name, v in self.asked.items() if v]
        return ", ".join((self.robot, *told))

    @abstractmethod
    def tables(self) -> list[TextTable]:
        """Return the results as tables."""

    @abstractmethod
    def _write_yaml(self, folder: Path) -> None:
        """Write EUROBENCH's files: a folder per run, a file per figure."""

    @abstractmethod
    def _write_page(self, folder: Path) -> None:
        """Write index.html."""

    def table(self) -> str:
        """Return the results as Markdown tables."""
        return "\n".join(table.markdown() for table in self.tables())

    def as_dict(self) -> dict[str, Any]:
        """Return everything as built-in types, for JSON."""
        return {
            "benchmark": self.NAME,
            "robot": self.robot,
            "subject": vars(self.subject),
            **self.asked,
            "results": [result.as_dict() for result in self.results],
            "out": None if self.folder is None else str(self.folder),
        }

    def write(self) -> None:
        """Write the JSON file, EUROBENCH's files and the page, if there is a folder."""
        folder = self.folder
        if folder is None:
            return
        write_json(folder / f"{self.NAME}.json", self.as_dict())
        write_whole(folder / "results.md", self.table().encode())
        eurobench = folder / "eurobench"
        # Those of another set of sizes would look like results of this one.
        for old in eurobench.rglob("*.yaml"):
            if old.read_bytes().startswith(_FIRST.encode()):
                old.unlink()
        self._write_yaml(eurobench)
        if words := lacking("drawing", "jinja2", "matplotlib", extra="report"):
            _LOG.warning("no page: %s", words)
        else:
            self._write_page(folder)


_LOG = logging.getLogger("surefoot")

TEMPLATE = Path(__file__).parent / "bench.html.j2"


class Figure(NamedTuple):
    """A drawing.

    Attributes:
        svg: the drawing.
        alt: its content in words.
    """

    svg: bytes
    alt: str

    @property
    def address(self) -> str:
        """Data URL of the drawing."""
        return inline_svg(self.svg)


class Section(NamedTuple):
    """A part of the page.

    Attributes:
        title: its heading.
        text: paragraphs.
        figures: drawings.
        tables: shown after the drawings.
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
    """Write index.html, one static file that opens offline."""
    text = render(
        TEMPLATE,
        title=title,
        robot=robot,
        subject=subject,
        intro=intro,
        sections=sections,
        sources=sources,
    )
    write_whole(folder / "index.html", text.encode())


def styles(everyone: Sequence[Under]) -> dict[Under, dict[str, Any]]:
    """Return drawing styles: a colour per controller, a dash per servo profile."""
    variants = list(dict.fromkeys(under.variant for under in everyone))
    profiles = list(dict.fromkeys(under.servo_profile for under in everyone))
    return {
        under: {
            "color": f"C{variants.index(under.variant)}",
            "linestyle": _LINES[profiles.index(under.servo_profile) % len(_LINES)],
        }
        for under in everyone
    }
