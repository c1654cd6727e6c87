"""Draws one small picture and ends; fails where OpenGL does not work.

``python -m sim_robot.gl_probe``, in a process of its own, since OpenGL may end it.
"""

from __future__ import annotations

import mujoco

SIZE = 16


def draw_small_picture() -> None:
    """Draws an empty world with the backend that ``MUJOCO_GL`` names."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with mujoco.Renderer(model, SIZE, SIZE) as renderer:
        renderer.update_scene(mujoco.MjData(model))
        renderer.render()


if __name__ == "__main__":
    draw_small_picture()
