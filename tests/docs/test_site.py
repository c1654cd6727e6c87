from __future__ import annotations

import re
from contextlib import nullcontext
from pathlib import Path

import pytest
import yaml
from mkdocs.commands.build import build as mkdocs_build
from mkdocs.config import load_config
from mkdocs.exceptions import Abort

from docs.site_build import generated_pages, source_links
from tests.command import run_python
from tests.once import made_once

ROOT = Path(__file__).parents[2]
LOADED = re.compile(r'<(?:script|img|link|iframe)[^>]+(?:src|href)="([^"]+)"')
FETCHED = re.compile(r"url\((?!data:)[\"']?(https?:)?//")


def build_well(site: Path) -> None:
    """Build the site as ``make docs`` does."""
    script = (
        "import logging, sys; logging.basicConfig();"
        "from mkdocs.config import load_config;"
        "from mkdocs.commands.build import build;"
        "build(load_config(sys.argv[1], site_dir=sys.argv[2]))"
    )
    words = ("-c", script, ROOT / "mkdocs.yml", site)
    done = run_python(*words, cwd=ROOT, NO_MKDOCS_2_WARNING="1")
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_once(tmp_path_factory, "site", build_well)


def test_every_page_is_there(site: Path) -> None:
    for page in (*(ROOT / "docs").glob("*.md"), *map(Path, generated_pages.PAGES)):
        inside = page.relative_to(ROOT / "docs") if page.is_absolute() else page
        assert (site / inside.with_suffix(".html")).is_file(), inside


def test_every_page_is_in_the_menu() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    menu = set(re.findall(r"[\w./-]+\.md", str(yaml.safe_load(text)["nav"])))
    written = {page.name for page in (ROOT / "docs").glob("*.md")}
    assert written | set(generated_pages.PAGES) <= menu


def test_nothing_comes_from_the_network(site: Path) -> None:
    for page in site.rglob("*.html"):
        loaded = LOADED.findall(page.read_text(encoding="utf-8"))
        assert loaded
        strangers = [url for url in loaded if re.match(r"(https?:)?//", url)]
        assert not strangers, page
    for sheet in site.rglob("*.css"):
        assert not FETCHED.search(sheet.read_text(encoding="utf-8")), sheet


def test_all_mathematics_is_set(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert "arithmatex" not in page.read_text(encoding="utf-8"), page
    text = (site / "controller.html").read_text(encoding="utf-8")
    formulas = re.findall(r"\$\$", (ROOT / "docs/controller.md").read_text("utf-8"))
    assert text.count('display="block"') == len(formulas) // 2 > 5
    # What the converter does not know it leaves as it is.
    assert not re.search(r"<(?:mi|mtext)>\\", text)
    assert (site / "assets" / "STIXTwoMath-Regular.ttf").stat().st_size > 1_000_000


def test_links_to_source_lead_to_their_lines(site: Path) -> None:
    text = (site / "controller.html").read_text(encoding="utf-8")
    links = re.findall(r'href="(source/[^"#]+\.html)#(__codelineno-0-\d+)"', text)
    assert len(links) > 15
    for page, anchor in links:
        assert f'id="{anchor}"' in (site / page).read_text(encoding="utf-8"), page


@pytest.mark.parametrize(
    ("link", "ends"),
    [("page.md#there", False), ("gone.md", True), ("page.md#gone", True)],
)
def test_a_broken_link_ends_the_build(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, link: str, ends: bool
) -> None:
    """By the settings of the site, on a page of its own."""
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "page.md").write_text(f"# There\n\n[one]({link})\n", encoding="utf-8")
    settings = load_config(
        str(ROOT / "mkdocs.yml"),
        docs_dir=str(docs),
        site_dir=str(tmp_path / "site"),
        nav=["page.md"],
        hooks=[],
    )
    with pytest.raises(Abort) if ends else nullcontext():
        mkdocs_build(settings)
    assert (link in caplog.text) is ends


def test_a_link_to_a_file_that_is_not_there_is_no_page() -> None:
    with pytest.raises(FileNotFoundError, match=r"stabilizer/gone\.py: no such file"):
        source_links.linked_paths({"cite.md": "[three](../stabilizer/gone.py)"})


def test_names_behind_source_links_must_exist() -> None:
    path = "stabilizer/control/tsid.py"
    line = source_links.line_of(path, "Tsid.solve")
    text = (ROOT / path).read_text(encoding="utf-8").splitlines()[line - 1]
    assert text == "    def solve("
    with pytest.raises(LookupError, match=r"tsid\.py has no Tsid\.dance"):
        source_links.line_of(path, "Tsid.dance")


def test_links_inside_code_stay_as_they_are() -> None:
    block = "```text\n[a](../schemas/codec.py)\n```\n"
    words = "[b](../schemas/codec.py) and [c](images/x.png)\n"
    assert source_links.rewrite(block + words, "page.md") == (
        f"{block}[b](source/schemas/codec.py.md) and [c](images/x.png)\n"
    )
