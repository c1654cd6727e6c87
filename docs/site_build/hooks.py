"""What mkdocs calls while it builds the site: generated pages, links, mathematics."""

from __future__ import annotations

import html
import re
import sys
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:  # mkdocs knows the folder of this file only
    sys.path.insert(0, str(ROOT))

# After the path above, without which it is not found.
from docs.site_build import generated_pages, source_links  # noqa: E402

_MATH = re.compile(
    r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL
)
_DOTTED_CAPITAL = re.compile(r'(<mover accent="true"><mi>[A-Z]</mi>)<mo>')
FONT = "STIXTwoMath-Regular.ttf"


def on_files(files: Files, config: Any) -> Files:
    """Add generated pages, a page for each source file linked to, and the font."""
    texts = {
        file.src_uri: file.content_string
        for file in files
        if file.is_documentation_page()
    }
    for uri, make in generated_pages.PAGES.items():
        texts[uri] = make()
        files.append(File.generated(config, uri, content=texts[uri]))
    for path in sorted(source_links.linked_paths(texts)):
        text = source_links.source_page(path)
        uri = source_links.page_uri(path)
        files.append(File.generated(config, uri, content=text))
    import ziamath  # ships the font that browsers set MathML in

    font = Path(ziamath.__file__).parent / "fonts" / FONT
    files.append(File.generated(config, f"assets/{FONT}", abs_src_path=str(font)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn links to files of the repository into links to their pages here."""
    if page.file.src_uri.startswith(source_links.FOLDER):
        return markdown
    return source_links.rewrite(markdown, page.file.src_uri)


def on_page_content(text: str, page: Any, config: Any, files: Files) -> str:
    """Set mathematics as MathML, and point links to source at their lines."""
    return source_links.point_at_lines(_MATH.sub(_to_mathml, text))


def _to_mathml(match: re.Match[str]) -> str:
    display = "block" if match[1] == "div" else "inline"
    tex = html.unescape(match[2]).strip()
    # As accents dots keep their size; over a capital they need some room.
    mathml = convert(tex, display=display).replace("<mover>", '<mover accent="true">')
    mathml = _DOTTED_CAPITAL.sub(r'\1<mo class="over-capital">', mathml)
    return f'<{match[1]} class="math">{mathml}</{match[1]}>'
