"""The page about the evaluation: one static file that opens offline."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from surefoot.robot_io.atomic_file import atomic_file
from surefoot.run_plan import settings_text
from surefoot.studies import paper as d
from surefoot.studies.cell import VARIANTS
from surefoot.studies.page import inline_svg, render
from surefoot.studies.paper_findings import Claim, Evidence, claims, goals
from surefoot.studies.tables import (
    COLUMNS,
    Summaries,
    cells_of,
    curves_over,
    draw_curves,
    markdown_table,
    write_csv,
)

TEMPLATE = Path(__file__).parent / "paper.html.j2"
FIGURES = "figures"


def write_report(
    folder: Path, summaries: Summaries, *, about: dict[str, Any], missing: int
) -> Path:
    """Write index.html and, beside it, the same numbers for programs.

    Args:
        folder: of the study; its ``figures`` are taken in.
        summaries: all that was measured, be it part of the study only.
        about: what the study's folder says of itself.
        missing: runs of the study that are not there.

    Returns:
        The page.
    """
    evidence = Evidence(summaries)
    paper, own = claims(evidence), goals(evidence)
    used = list(dict.fromkeys(group.variant for group in summaries))
    runs = [summary.runs for summary in summaries.values()]
    page = render(
        TEMPLATE,
        code=about.get("code", "")[:12],
        runs=sum(runs),
        seeds=max(runs, default=0),
        missing=missing,
        claims=paper,
        goals=own,
        columns=COLUMNS,
        rows=[cells_of(group, summary) for group, summary in summaries.items()],
        curves=_curves(summaries),
        figures=_figures(folder),
        variants=[VARIANTS[name] for name in used],
        settings=_settings(used),
    )
    write_csv(folder / "summary.csv", summaries)
    findings = {"claims": paper, "goals": own}
    _write(folder / "findings.json", msgspec.json.encode(findings))
    _write(folder / "results.md", _markdown(paper, own, summaries).encode())
    _write(folder / "index.html", page.encode())
    return folder / "index.html"


def _settings(names: list[str]) -> dict[str, str]:
    """Return all settings of these controllers, also those for other servos."""
    texts = {}
    for name in names:
        variant = VARIANTS[name]
        texts[name] = settings_text(variant.resolve(d.IDEAL))
        for profile in variant.settings_of:
            texts[f"{name}, {profile}"] = settings_text(variant.resolve(profile))
    return texts


def _curves(summaries: Summaries) -> list[str]:
    pages = []
    for scenario in d.RAMPS:
        curves = curves_over(summaries, scenario=scenario, name=d.TILT_RATE)
        if curves:
            svg = draw_curves(
                curves,
                xlabel="tilt rate [deg/s]",
                title=scenario,
                mark=(d.PAPER_LIMIT_DEG_S, "paper"),
            )
            pages.append(inline_svg(svg))
    return pages


def _figures(folder: Path) -> list[str]:
    paths = sorted((folder / FIGURES).glob("*.svg"))
    return [inline_svg(path.read_bytes()) for path in paths]


def _markdown(paper: list[Claim], own: list[Claim], summaries: Summaries) -> str:
    parts = []
    for title, findings in (("The paper's claims", paper), ("Our goals", own)):
        lines = [
            f"### {title}",
            "",
            "| statement | measured | verdict |",
            "|---|---|---|",
        ]
        lines += [f"| {f.statement} | {f.measured} | {f.verdict} |" for f in findings]
        parts.append("\n".join(lines) + "\n")
    parts.append("### All cases\n\n" + markdown_table(summaries))
    return "\n".join(parts)


def _write(path: Path, data: bytes) -> None:
    with atomic_file(path) as file:
        file.write(data)
