"""From folders of runs to the folder of a report."""

from __future__ import annotations

from pathlib import Path

from cli.console import count_bar
from cli.report.run_data import RunData
from cli.report.scene_page import frame_rows, scene_page
from cli.report.video import draw_animation, draw_video
from cli.report.write_page import REPORT_MARKER, Media, write_page
from cli.run_directory import RunDirectory
from cli.view.robot_shape import RobotShape


def write_report(
    runs: list[RunData], out: Path, *, video: bool, animation: bool
) -> None:
    """Writes a report, whole or not at all.

    Args:
        runs: what it tells of.
        out: its folder; a former report there is replaced.
        video: also a video and a still of each run.
        animation: also a short loop of each run.

    Raises:
        UsageError: something else than a report stands there.
    """
    shape = RobotShape(runs[0].robot)
    with RunDirectory(out, marker=REPORT_MARKER, content="a report") as folder:
        media = [
            _media(
                folder.path, index, run, shape=shape, video=video, animation=animation
            )
            for index, run in enumerate(runs, start=1)
        ]
        write_page(folder.path, runs, media, shape=shape)
        folder.keep()


def _media(
    folder: Path,
    index: int,
    run: RunData,
    *,
    shape: RobotShape,
    video: bool,
    animation: bool,
) -> Media:
    media = Media(scene=f"scene-{index}.html")
    frames = len(frame_rows(run)) - 1
    with count_bar(
        f"{run.label}: scene", total=frames, done=0, of="frames"
    ) as on_frame:
        page = scene_page(run, shape, on_frame=on_frame)
    (folder / media.scene).write_text(page, encoding="utf-8")
    if video:
        media = media._replace(
            video=f"video-{index}.mp4", thumbnail=f"thumbnail-{index}.png"
        )
        draw_video(run, folder / media.video, thumbnail=folder / media.thumbnail)
    if animation:
        media = media._replace(animation=f"animation-{index}.webp")
        draw_animation(run, folder / media.animation)
    return media
