"""Links from pages to files of the repository, and a page for each such file.

On GitHub such a link, ``../stabilizer/control/tsid.py#Tsid.solve``, opens the file.
In the site it opens a page that shows the file, at the line of what is named behind
``#``.
"""

from __future__ import annotations

import ast
import posixpath
import re
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = "source/"
_DOCS = "docs"
_LINK = re.compile(r"(?<=\]\()(\.\./[^)\s#]+)(?:#([\w.]+))?(?=\))")
_FENCED = re.compile(r"^(?P<fence>`{3,}).*?^(?P=fence)\s*$", re.DOTALL | re.MULTILINE)
_LINE = re.compile(r'\?line=(\d+)(?=")')
_LANGUAGES = {
    ".py": "python",
    ".toml": "toml",
    ".json": "json",
    ".json5": "json",
    ".yaml": "yaml",
    ".yml": "yaml",
    ".urdf": "xml",
    ".sh": "bash",
    ".service": "ini",
}
_SHOWN_ELSEWHERE = {"CHANGELOG.md": "changelog.md"}


def linked_paths(pages: dict[str, str]) -> set[str]:
    """Files and folders of the repository that pages link to.

    Raises:
        FileNotFoundError: a link leads to nothing.
    """
    found: set[str] = set()
    for page, text in pages.items():
        for path, _ in links(text, page):
            if not (ROOT / path).exists():
                raise FileNotFoundError(f"docs/{page}: links to {path}: no such file")
            if path not in _SHOWN_ELSEWHERE:
                found.add(path)
    for path in tuple(found):
        if (ROOT / path).is_dir():
            found |= {f"{path}/{name}" for name in _entries(path)}
    return found


def links(text: str, page: str) -> list[tuple[str, str]]:
    """(path in the repository, name behind #) of each link that leaves docs."""
    pairs = []
    for match in _LINK.finditer(_FENCED.sub("", text)):
        path = _in_repository(match[1], page)
        if not path.startswith(f"{_DOCS}/"):
            pairs.append((path, match[2] or ""))
    return pairs


def page_uri(path: str) -> str:
    """The page that shows a file or folder."""
    return f"{FOLDER}{path}.md"


def source_page(path: str) -> str:
    """Markdown that shows a file, or lists a folder."""
    head = f"---\nsearch:\n  exclude: true\n---\n\n# `{path}`\n\n"
    place = ROOT / path
    if place.is_dir():
        folder = posixpath.basename(path)
        return head + "".join(
            f"- [`{name}`]({folder}/{name}.md)\n" for name in _entries(path)
        )
    text = place.read_text(encoding="utf-8")
    fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
    language = _LANGUAGES.get(place.suffix, "text")
    return f'{head}{fence} {{ .{language} linenums="1" }}\n{text}\n{fence}\n'


def rewrite(markdown: str, page: str) -> str:
    """Turn links that leave docs into links to pages of the site.

    Raises:
        LookupError: a file has no such function or class.
    """

    def replace(match: re.Match[str]) -> str:
        path = _in_repository(match[1], page)
        if path.startswith(f"{_DOCS}/"):
            return match[0]
        uri = _SHOWN_ELSEWHERE.get(path, page_uri(path))
        target = posixpath.relpath(uri, posixpath.dirname(page) or ".")
        line = f"?line={line_of(path, match[2])}" if match[2] else ""
        return target + line

    pieces, end = [], 0
    for block in _FENCED.finditer(markdown):
        pieces += [_LINK.sub(replace, markdown[end : block.start()]), block[0]]
        end = block.end()
    return "".join([*pieces, _LINK.sub(replace, markdown[end:])])


def point_at_lines(content: str) -> str:
    """Put the anchors of lines into links, after mkdocs has checked their pages."""
    return _LINE.sub(r"#__codelineno-0-\1", content)


def line_of(path: str, name: str) -> int:
    """Line at which a function, class, method or constant is defined.

    Raises:
        LookupError: no such name there.
    """
    node: ast.AST = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    for part in name.split("."):
        body: Iterable[ast.AST] = getattr(node, "body", ())
        found = next((child for child in body if part in _names(child)), None)
        if found is None:
            raise LookupError(f"{path} has no {name}; a page links to it")
        node = found
    line: int = getattr(node, "lineno", 1)
    return line


def _names(node: ast.AST) -> list[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else []
    if isinstance(node, ast.AnnAssign):
        targets = [node.target]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def _in_repository(link: str, page: str) -> str:
    here = posixpath.join(_DOCS, posixpath.dirname(page))
    return posixpath.normpath(posixpath.join(here, link))


def _entries(path: str) -> list[str]:
    """Names of the text files right in a folder."""
    return sorted(
        item.name
        for item in (ROOT / path).iterdir()
        if item.is_file() and item.suffix not in (".pyc", ".pem", ".png")
    )
