"""Reads a robot's URDF into an editable MuJoCo model."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco


def read_urdf(path: Path, *, visuals: bool) -> mujoco.MjSpec:
    """Reads a URDF; fixed links stay bodies of their own, nothing collides.

    Args:
        path: of the URDF.
        visuals: keep its <visual> elements, for pictures; else nothing is left of
            its geometry.

    Returns:
        The model, not compiled.
    """
    root = ElementTree.parse(path).getroot()
    # MuJoCo drops visuals while it reads, unless the file itself says otherwise.
    extension = root.find("mujoco")
    if extension is None:
        extension = ElementTree.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ElementTree.SubElement(extension, "compiler")
    compiler.set("discardvisual", "false" if visuals else "true")
    compiler.set("fusestatic", "false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    # From here on it would drop every geom that only explicit pairs let collide.
    spec.compiler.discardvisual = False
    spec.modelfiledir = str(path.parent)
    for geom in list(spec.geoms):
        if geom.contype or geom.conaffinity:
            spec.delete(geom)
    return spec
