"""Videos of a run, drawn by the simulator without a window."""

from __future__ import annotations

import ctypes.util
import os
import sys
from collections.abc import Iterator
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import EnvironmentFailedError
from surefoot.installation import lacking
from surefoot.presentation import CountBar, no_bar
from surefoot.report.curves import STILL
from surefoot.report.run_data import RunData
from surefoot.schemas.arrays import Array

if TYPE_CHECKING:  # loads MuJoCo, for which MUJOCO_GL must be set before
    from surefoot.sim_robot.render import Camera

VIDEO_SIZE, VIDEO_HZ = (960, 720), 25.0
ANIMATION_SIZE, ANIMATION_HZ = (600, 450), 20.0
ANIMATION_S = (4.0, 7.0)
"""Least and greatest length of an animation [s]; see :func:`best_loop`."""
ANIMATION_QUALITY = 72
MS_PER_S = 1000
FOLLOW_S = 0.8
"""Half the time over which a walking robot's place is averaged [s]: the camera follows
without swaying."""
STEP_S = 0.02
"""Step between compared moments [s]."""


def best_loop(
    poses: Array, *, period_s: float, length_s: tuple[float, float]
) -> tuple[int, int]:
    """Find the stretch of a motion whose end is most like its start.

    Both pose and speed are compared.

    Args:
        poses: (n, m) numbers that describe each picture.
        period_s: time from one row to the next [s].
        length_s: least and greatest length of the stretch [s].

    Returns:
        First and last row; the whole motion if it is shorter than a stretch.
    """
    step = max(1, round(STEP_S / period_s))
    coarse = poses[::step]
    shortest, longest = (round(length / (step * period_s)) for length in length_s)
    if len(coarse) <= shortest + 1:
        return 0, len(poses) - 1
    # Speed is weighted as the change of the pose in a tenth of a second.
    speed = np.gradient(coarse, axis=0) * (0.1 / STEP_S)
    seen = np.hstack((coarse, speed))
    best, found = np.inf, (0, shortest)
    for length in range(shortest, min(longest, len(coarse) - 1) + 1):
        apart = np.sum((seen[length:] - seen[:-length]) ** 2, axis=1)
        start = int(np.argmin(apart))
        # A robot at rest is always alike, so prefer stretches with more motion.
        moved = np.ptp(coarse[start : start + length], axis=0).sum()
        score = float(apart[start]) / (moved + 1e-9) ** 2
        if score < best:
            best, found = score, (start, start + length)
    return found[0] * step, found[1] * step


def load_drawing() -> None:
    """Load the renderer, without a display if there is none.

    Call it before anything else loads MuJoCo, which reads ``MUJOCO_GL`` then. A value
    set by the user is kept.

    Raises:
        EnvironmentFailedError: it cannot be loaded; the message says what to install.
    """
    _choose_gl()
    try:
        import_module("surefoot.sim_robot.render")
    except (ImportError, RuntimeError, AttributeError, OSError) as error:
        # Each missing OpenGL back end fails in its own way.
        raise EnvironmentFailedError(
            f"no picture can be drawn: {error}. MUJOCO_GL is "
            f"{os.environ.get('MUJOCO_GL', 'not set')}; set it to egl or osmesa; on "
            "Debian: apt-get install libegl1 libgl1-mesa-dri (or libosmesa6)"
        ) from error


def _choose_gl() -> None:
    if sys.platform != "linux" or "MUJOCO_GL" in os.environ:
        return
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return
    for library, backend in (("EGL", "egl"), ("OSMesa", "osmesa")):
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = backend
            return


def check_drawing(run: RunData, *, video: bool) -> None:
    """Check that pictures can be drawn, before any work is done.

    Raises:
        EnvironmentFailedError: they cannot; the message says what to install.
    """
    from surefoot.sim_robot.render import RenderError

    if video:
        check_encoder()
    try:
        next(_pictures(run, run.drawable(np.zeros(1)), size=(64, 48)))
    except RenderError as error:
        raise EnvironmentFailedError(str(error)) from error


def check_encoder() -> None:
    """Check that a video can be encoded.

    Raises:
        EnvironmentFailedError: it cannot; the message says what to install.
    """
    if words := lacking("--video", "imageio_ffmpeg", extra="video"):
        raise EnvironmentFailedError(words)


def draw_video(
    run: RunData, path: Path, *, thumbnail: Path, bar: CountBar = no_bar
) -> None:
    """Write a run as mp4 (H.264) in simulated time, and a picture of its middle."""
    from imageio_ffmpeg import write_frames
    from PIL import Image

    rows = _rows(run, 0, run.signals.count - 1, rate_hz=VIDEO_HZ)
    with (
        closing(write_frames(str(path), VIDEO_SIZE, fps=VIDEO_HZ, quality=7)) as film,
        bar(f"{run.label}: video", total=len(rows), done=0, of="frames") as on_frame,
    ):
        film.send(None)  # starts the encoder
        for index, picture in enumerate(_pictures(run, rows, size=VIDEO_SIZE)):
            film.send(picture)
            if index == len(rows) // 2:
                Image.fromarray(picture).save(thumbnail)
            on_frame()


def draw_animation(run: RunData, path: Path, *, bar: CountBar = no_bar) -> None:
    """Write some seconds of a run as a looping WebP, small enough for a web page."""
    from PIL import Image

    start, end = best_loop(
        _pose(run), period_s=run.robot.period_s, length_s=ANIMATION_S
    )
    rows = _rows(run, start, end, rate_hz=ANIMATION_HZ)[:-1]  # last equals first
    with bar(
        f"{run.label}: animation", total=len(rows), done=0, of="frames"
    ) as on_frame:
        frames = []
        for picture in _pictures(run, rows, size=ANIMATION_SIZE):
            frames.append(Image.fromarray(picture))
            on_frame()
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=round(MS_PER_S / ANIMATION_HZ),
        loop=0,
        quality=ANIMATION_QUALITY,
        method=6,
    )


def _pose(run: RunData) -> Array:
    """Return (n, m) numbers that describe what a picture shows.

    If the ground moves, its poses alone, since a jump of the ground is what one would
    see. In a walk the joints, without the robot's place, which the camera follows.
    """
    signals = run.signals
    walks = run.is_walk
    if "true_platform_pose" in signals:
        ground: Array = signals["true_platform_pose"].reshape(signals.count, -1)
        if np.ptp(ground, axis=0).max() > STILL:
            return np.hstack((ground, signals["q"])) if walks else ground
    if walks:
        return signals["q"]
    return np.hstack((signals["true_base_pose"], signals["q"]))


def _rows(run: RunData, start: int, end: int, *, rate_hz: float) -> NDArray[np.int64]:
    frames = int((end - start) * run.robot.period_s * rate_hz) + 1
    return run.drawable(np.linspace(start, end, max(frames, 2)))


def _pictures(
    run: RunData, rows: NDArray[np.int64], *, size: tuple[int, int]
) -> Iterator[NDArray[np.uint8]]:
    from surefoot.sim_robot.render import Renderer

    width, height = size
    cameras = _cameras(run, rows)
    with Renderer(
        run.robot, run.scenario, width=width, height=height, quick=True
    ) as renderer:
        for row, camera in zip(rows, cameras, strict=True):
            yield renderer.draw_recorded(run.signals, row=int(row), camera=camera)


def _cameras(run: RunData, rows: NDArray[np.int64]) -> list[Camera]:
    """Return the camera of each picture; it moves along with a walking robot."""
    from surefoot.sim_robot.render import Camera

    usual = Camera()
    if not run.is_walk:
        return [usual] * len(rows)
    half = round(FOLLOW_S / run.robot.period_s)
    place = run.signals["true_base_pose"][:, :2]
    x, y, z = usual.target
    return [
        Camera(target=(x + float(a), y + float(b), z))
        for a, b in (
            np.nanmean(place[max(0, row - half) : row + half + 1], axis=0)
            for row in rows
        )
    ]
