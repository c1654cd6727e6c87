"""The page of the paper's evaluation, and its figures."""

from __future__ import annotations

import base64
import platform
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from surefoot.out_folder import write_whole
from surefoot.presentation import markdown, svg_of
from surefoot.run_plan import settings_text
from surefoot.schemas.arrays import Array
from surefoot.studies.cell import VARIANTS, Cell, Group
from surefoot.studies.paper import (
    IDEAL,
    PAPER_LIMIT_DEG_S,
    RAMPS,
    TILT_RATE,
    TUNED,
    WHOLE_BODY,
    Claim,
    Evidence,
    claims,
    goals,
)
from surefoot.studies.summaries import (
    COLUMNS,
    Summaries,
    cells_of,
    curves_over,
    draw_curves,
    markdown_table,
    write_csv,
)

STYLE = Path(__file__).parent / "page.css"
PACKAGES = ("surefoot", "mujoco", "pin", "piqp", "numpy", "scipy")
SHOWN = {
    "moving-platform-slow": "One platform, slow",
    "moving-platform-fast": "One platform, fast",
    "two-platforms-fast": "A platform per foot, fast",
    "falling-platform-80": "The left platform falls by 80 mm",
}
EVERY_TICKS = 10
FIGURES = "figures"


def render(template: Path, **values: Any) -> str:
    """Fill a template.

    Args:
        template: a Jinja file; it also gets ``style``, ``made``, ``versions`` and
            ``python``.
        values: its values.
    """
    import jinja2
    from markupsafe import Markup

    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.from_string(template.read_text(encoding="utf-8")).render(
        style=Markup(STYLE.read_text(encoding="utf-8")),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        versions={name: version(name) for name in PACKAGES},
        python=platform.python_version(),
        **values,
    )


def inline_svg(svg: bytes) -> str:
    """Return a drawing as a data URL: its ids then clash with no other drawing's."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg).decode()


COMPARED = (WHOLE_BODY, TUNED)


def record(
    scenario: str, variant: str, values: tuple[tuple[str, Any], ...] = ()
) -> dict[str, Array]:
    """Return the signals of one run with seed 0 and the ideal servo."""
    from surefoot.signals import memory_sinks
    from surefoot.simulation import Simulation
    from surefoot.stabilizer.factory import make_controller

    cell = Cell(Group(scenario, values, variant, IDEAL), seed=0)
    plan = cell.plan(robot="walker", overrides=())
    sim = Simulation.of_plan(plan, sinks=memory_sinks())
    sim.run(make_controller(plan.controller, plan.robot, plan.settings))
    return dict(sim.signals)


def draw(title: str, runs: dict[str, dict[str, Array]]) -> bytes:
    """Draw base position and rotation, force and moment of the left sole.

    Returns:
        SVG.
    """
    from matplotlib.figure import Figure
    from scipy.spatial.transform import Rotation

    figure = Figure(figsize=(9.0, 7.2), layout="constrained")
    figure.suptitle(title)
    grid: Any = figure.subplots(4, len(runs), sharex=True, sharey="row", squeeze=False)
    for column, (variant, arrays) in enumerate(runs.items()):
        time_s = arrays["time_s"][::EVERY_TICKS]
        base = arrays["true_base_pose"]
        panels = (
            (1e3 * (base[:, :3] - base[0, :3]), "xyz"),
            (Rotation.from_quat(base[:, 3:]).as_euler("xyz", degrees=True), "rpy"),
            (arrays["true_F"][:, :3], "xyz"),
            (arrays["true_F"][:, 3:6], "xyz"),
        )
        for row, (values, names) in enumerate(panels):
            axes = grid[row, column]
            for index, name in enumerate(names):
                label = {"r": "roll", "p": "pitch"}.get(name, name)
                label = "yaw" if names == "rpy" and index == 2 else label
                axes.plot(time_s, values[::EVERY_TICKS, index], lw=0.9, label=label)
            axes.grid(alpha=0.3)
            if column == len(runs) - 1:  # outside: inside it hides curves
                axes.legend(
                    fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5)
                )
        grid[0, column].set_title(variant)
        grid[-1, column].set_xlabel("time [s]")
    labels = ("base position [mm]", "base rotation [deg]", "force [N]", "moment [N m]")
    for row, label in enumerate(labels):
        grid[row, 0].set_ylabel(label)
    return svg_of(figure, legend=False)


TEMPLATE = Path(__file__).parent / "paper.html.j2"


def write_report(
    folder: Path, summaries: Summaries, *, about: dict[str, Any], missing: int
) -> Path:
    """Write index.html, and a file with the same numbers for programs.

    Args:
        folder: folder of the study; its ``figures`` become part of the page.
        summaries: all results, also those of an incomplete study.
        about: description in the study's folder.
        missing: runs of the study that are missing.

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
        figures=[
            inline_svg(path.read_bytes())
            for path in sorted((folder / FIGURES).glob("*.svg"))
        ],
        variants=[VARIANTS[name] for name in used],
        settings=_settings(used),
    )
    write_csv(folder / "summary.csv", summaries)
    findings = {"claims": paper, "goals": own}
    write_whole(folder / "findings.json", msgspec.json.encode(findings))
    write_whole(folder / "results.md", _markdown(paper, own, summaries).encode())
    write_whole(folder / "index.html", page.encode())
    return folder / "index.html"


def _settings(names: list[str]) -> dict[str, str]:
    """Return all settings of these controllers, with those for single profiles."""
    texts = {}
    for name in names:
        variant = VARIANTS[name]
        texts[name] = settings_text(variant.resolve(IDEAL))
        for profile in variant.settings_of:
            texts[f"{name}, {profile}"] = settings_text(variant.resolve(profile))
    return texts


def _curves(summaries: Summaries) -> list[str]:
    pages = []
    for scenario in RAMPS:
        curves = curves_over(summaries, scenario=scenario, name=TILT_RATE)
        if curves:
            svg = draw_curves(
                curves,
                xlabel="tilt rate [deg/s]",
                title=scenario,
                mark=(PAPER_LIMIT_DEG_S, "paper"),
            )
            pages.append(inline_svg(svg))
    return pages


def _markdown(paper: list[Claim], own: list[Claim], summaries: Summaries) -> str:
    parts = []
    for title, findings in (("The paper's claims", paper), ("Our goals", own)):
        rows = [(f.statement, f.measured, f.verdict) for f in findings]
        told = markdown(("statement", "measured", "verdict"), rows)
        parts.append(f"### {title}\n\n{told}")
    parts.append("### All cases\n\n" + markdown_table(summaries))
    return "\n".join(parts)
