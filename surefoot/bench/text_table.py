"""Tables of results: for the terminal, a page, Markdown."""

from __future__ import annotations

from typing import NamedTuple

NONE = "-"


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
