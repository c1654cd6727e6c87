"""Google docstrings as Markdown."""

from __future__ import annotations

import re
from dataclasses import dataclass

_SECTION = re.compile(r"^(Args|Attributes|Returns|Raises|Yields|Example):$")
_ROLE = re.compile(r":(?:class|func|meth|data|mod|attr|exc):`~?([\w.]+)`")
_ENTRY = re.compile(r"^(\*{0,2}\w[\w., ]*): (.*)$", re.DOTALL)
_HEADINGS = {
    "Args": "Arguments",
    "Attributes": "Attributes",
    "Returns": "Returns",
    "Raises": "Raises",
    "Yields": "Yields",
    "Example": "Example",
}
_INDENT = 4


@dataclass(frozen=True)
class Docstring:
    """A docstring in Markdown.

    Attributes:
        text: what stands before the first section.
        sections: titles as in the docstring, and each section with its heading.
    """

    text: str
    sections: list[tuple[str, str]]


def parse(doc: str, *, known: set[str]) -> Docstring:
    """Turn a docstring into Markdown.

    Args:
        doc: without indentation, as ``inspect.getdoc`` gives it.
        known: names with a heading of their own on the page, to link to.
    """
    titles, bodies = [""], [[""]]
    for line in doc.splitlines():
        heading = _SECTION.match(line)
        if heading:
            titles.append(heading[1])
            bodies.append([])
        else:
            bodies[-1].append(line)
    sections = []
    for title, lines in zip(titles[1:], bodies[1:], strict=True):
        sections.append((title, _section(title, lines, known)))
    return Docstring(_prose("\n".join(bodies[0]).strip(), known) + "\n", sections)


def _section(title: str, lines: list[str], known: set[str]) -> str:
    inner = [line[_INDENT:] for line in lines]
    if title in ("Returns", "Yields", "Example"):
        body = _prose("\n".join(inner).strip(), known)
        return f"**{_HEADINGS[title]}**\n\n{body}\n"
    items = []
    for entry in _entries(inner):
        match = _ENTRY.match(entry)
        name, text = (match[1], match[2]) if match else ("", entry)
        words = _prose(" ".join(text.split()), known)
        items.append(f"- `{name}`: {words}" if name else f"- {words}")
    return f"**{_HEADINGS[title]}**\n\n" + "\n".join(items) + "\n"


def _entries(lines: list[str]) -> list[str]:
    """Lines that begin at the margin, each with the indented ones below it."""
    entries: list[str] = []
    for line in lines:
        if line and not line.startswith(" "):
            entries.append(line)
        elif line.strip() and entries:
            entries[-1] += f"\n{line.strip()}"
    return entries


def _prose(text: str, known: set[str]) -> str:
    """Roles and literals as Markdown; blocks after ``::`` as code."""

    def link(match: re.Match[str]) -> str:
        name = match[1].rsplit(".", 1)[-1]
        return f"[`{name}`](#{name.lower()})" if name in known else f"`{name}`"

    text = _ROLE.sub(link, text).replace("``", "`")
    pieces = re.split(r"(?m)^(.*)::\n\n((?: {4}.*\n?|\n)+)", text)
    parts = [pieces[0]]
    for lead, block, rest in zip(pieces[1::3], pieces[2::3], pieces[3::3], strict=True):
        code = "\n".join(line[_INDENT:] for line in block.rstrip().splitlines())
        parts.append(f"{lead}\n\n```python\n{code}\n```\n\n{rest}")
    return "".join(parts).strip()
