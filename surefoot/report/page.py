"""The report's page: a folder that opens offline."""

from __future__ import annotations

import shlex
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from surefoot.controllers import MOST_TICKS, compute_margins, loop_delay_ms
from surefoot.out_folder import OutFolder, write_json
from surefoot.presentation import CountBar, no_bar
from surefoot.report.curves import BUCKETS, curves, footsteps, steps_of
from surefoot.report.panels import (
    RUN_COLOURS,
    frame_rows,
    marks_of,
    panel_groups,
    scene_page,
    tells_forces,
)
from surefoot.report.run_data import RunData, load_runs
from surefoot.report.tables import figure_rows, sentence, setting_rows
from surefoot.report.video import check_drawing, draw_animation, draw_video
from surefoot.run_folder import read_ends
from surefoot.schemas.arrays import MS_PER_S
from surefoot.schemas.settings import setting_names
from surefoot.view.robot_shape import RobotShape
from surefoot.view.scene import LEGEND, WALK_LEGEND

HERE = Path(__file__).parent
REPORT_MARKER = "report.json"
"""File in every report folder; a folder without it is never overwritten."""
REPORT_FILES = (
    *(REPORT_MARKER, "index.html", "data.js", "report.js", "plotly.min.js"),
    *("scene-*.html", "video-*.mp4", "thumbnail-*.png", "animation-*.webp"),
)
"""All files that a report may write."""
_NO_RECORD = (
    "no record of the bus (run.mcap), as with --inline; modes and the times of the "
    "commands are missing, since only the bus tells them."
)


class Media(NamedTuple):
    """Names of a run's files in the page's folder; empty if not made."""

    scene: str
    video: str = ""
    thumbnail: str = ""
    animation: str = ""


def write_page(folder: Path, runs: list[RunData], media: list[Media]) -> None:
    """Write the page and its scripts to a folder that exists."""
    from plotly.offline import get_plotlyjs

    drawn = [(run.label, list(curves(run))) for run in runs]
    groups = panel_groups(drawn)
    data = {
        "groups": groups,
        "runs": [
            {"label": run.label, "colour": RUN_COLOURS[index]}
            for index, run in enumerate(runs)
        ],
        "span": [0.0, max(float(run.signals.time_s[-1]) for run in runs)],
        "marks": [mark._asdict() for mark in marks_of(runs)],
    }
    script = b"window.surefootReport = " + msgspec.json.encode(data) + b";\n"
    (folder / "data.js").write_bytes(script)
    (folder / "plotly.min.js").write_text(get_plotlyjs(), encoding="utf-8")
    (folder / "report.js").write_bytes((HERE / "report.js").read_bytes())
    page = _render(runs, media, groups)
    (folder / "index.html").write_text(page, encoding="utf-8")
    about = {
        "runs": [run.label for run in runs],
        "results": [msgspec.to_builtins(run.result) for run in runs],
        "surefoot": version("surefoot"),
    }
    write_json(folder / REPORT_MARKER, about)


def _render(
    runs: list[RunData], media: list[Media], groups: list[dict[str, Any]]
) -> str:
    import jinja2

    environment = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    template = environment.from_string(
        (HERE / "report.html.j2").read_text(encoding="utf-8")
    )
    settings = setting_rows(runs)
    scenarios: dict[str, list[str]] = {}
    for run in runs:
        scenarios.setdefault(run.scenario_text, []).append(run.label)
    return template.render(
        title=_title(runs),
        version=version("surefoot"),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        several_scenarios=len(scenarios) > 1,
        runs=[
            {**_head(run), **files._asdict(), "colour": RUN_COLOURS[index]}
            for index, (run, files) in enumerate(zip(runs, media, strict=True))
        ],
        legend=LEGEND + (WALK_LEGEND if any(map(steps_of, runs)) else ()),
        figures=figure_rows([run.result for run in runs]),
        buckets=BUCKETS,
        groups=groups,
        scenarios=scenarios,
        settings=settings,
        changed_settings=[row for row in settings if any(row.is_changed)],
        versions=_versions(runs),
    )


def _title(runs: list[RunData]) -> str:
    if len(runs) == 1:
        return f"{runs[0].result.scenario}, {runs[0].result.controller}"
    scenarios = dict.fromkeys(run.result.scenario for run in runs)
    return f"{', '.join(scenarios)}: {' against '.join(run.label for run in runs)}"


def _head(run: RunData) -> dict[str, Any]:
    result, about, heard = run.result, run.about, run.heard
    gaps = [_NO_RECORD if heard is None else heard.gap]
    if run.signals.gaps:
        gaps.append(f"{'; '.join(run.signals.gaps)}. The figures are of the whole run.")
    return {
        "label": run.label,
        "outcome": sentence(result),
        "is_up": result.outcome.is_up,
        "scenario": result.scenario,
        "controller": result.controller,
        "robot": result.robot,
        "servo_profile": about.servo_profile,
        "seed": result.seed,
        "mode": result.mode,
        "started": about.started,
        "command": shlex.join(about.command),
        "tells_forces": tells_forces(run),
        "gap": " ".join(filter(None, gaps)),
        "margins": "; ".join(_margins(run)),
        "logs": run.logs,
        "footsteps": footsteps(run),
    }


def _margins(run: RunData) -> list[str]:
    """Return a run's stability margins in words; whole-body stabilizer only."""
    if run.result.controller != "whole-body":
        return []
    names = [name for name in setting_names() if name in run.settings]
    return compute_margins(
        run.robot,
        settings={name: run.settings[name] for name in names},
        delay_ms=min(
            loop_delay_ms(run.scenario.delay, run.robot),
            MS_PER_S * MOST_TICKS * run.robot.period_s,
        ),
    ).in_words()


def _versions(runs: list[RunData]) -> dict[str, list[str]]:
    """Return the values of each run, by package, for Python and for the platform."""
    names = dict.fromkeys(name for run in runs for name in run.about.packages)
    versions = {
        name: [str(run.about.packages.get(name, "")) for run in runs] for name in names
    }
    versions["python"] = [run.about.python for run in runs]
    versions["platform"] = [run.about.platform for run in runs]
    return versions


def write_report(
    run_folders: list[Path],
    out: Path,
    *,
    overwrite: bool = False,
    video: bool = False,
    animation: bool = False,
    bar: CountBar = no_bar,
) -> None:
    """Write a report; on failure nothing is left.

    Raises:
        UsageError: ``out`` exists and may not be overwritten, or a run is missing,
            unfinished or unreadable.
        EnvironmentFailedError: a video or animation cannot be drawn here.
    """
    for run_folder in run_folders:
        read_ends(run_folder)
    with OutFolder(
        out,
        marker=REPORT_MARKER,
        content="a report",
        ours=REPORT_FILES,
        overwrite=overwrite,
    ) as folder:
        runs = load_runs(run_folders)
        if video or animation:
            check_drawing(runs[0], video=video)
        shape = RobotShape(runs[0].robot)
        media = [
            _media(
                folder.path,
                index,
                run,
                shape=shape,
                video=video,
                animation=animation,
                bar=bar,
            )
            for index, run in enumerate(runs, start=1)
        ]
        write_page(folder.path, runs, media)


def _media(
    folder: Path,
    index: int,
    run: RunData,
    *,
    shape: RobotShape,
    video: bool,
    animation: bool,
    bar: CountBar,
) -> Media:
    media = Media(scene=f"scene-{index}.html")
    frames = len(frame_rows(run)) - 1
    with bar(f"{run.label}: scene", total=frames, done=0, of="frames") as on_frame:
        page = scene_page(run, shape, on_frame=on_frame)
    (folder / media.scene).write_text(page, encoding="utf-8")
    if video:
        media = media._replace(
            video=f"video-{index}.mp4", thumbnail=f"thumbnail-{index}.png"
        )
        draw_video(
            run, folder / media.video, thumbnail=folder / media.thumbnail, bar=bar
        )
    if animation:
        media = media._replace(animation=f"animation-{index}.webp")
        draw_animation(run, folder / media.animation, bar=bar)
    return media
