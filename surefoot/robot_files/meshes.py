"""Meshes of a URDF: found where ROS would look, and carried along with a new robot."""

from __future__ import annotations

import filecmp
import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path

from surefoot.errors import UsageError
from surefoot.robot_files.draft import Draft
from surefoot.robot_io.atomic_file import atomic_file

Copies = dict[Path, Path]
"""Where a file is to go, to where it is."""


def find_meshes(draft: Draft, package_dirs: Sequence[Path]) -> None:
    """Point every mesh at its file; those that are not there are left out."""
    lost: list[str] = []
    for link, shape, mesh in _meshes(draft):
        name = mesh.get("filename", "")
        found = _mesh_path(name, draft.path, package_dirs)
        if found is None:
            link.remove(shape)
            lost.append(name)
        else:
            mesh.set("filename", str(found))
    if lost:
        draft.note(
            "left to you",
            f"{len(lost)} meshes are not there and were left out, {lost[0]} for one; "
            "say where packages are with --package-dir",
        )


def carry_meshes(draft: Draft, out: Path, *, folder: str) -> Copies:
    """Name every mesh relative to the new URDF, so that both can be moved together.

    What is below the URDF's folder stays where it is. Everything else is to be copied
    into one of its own, as the files lie to each other now: they may name one another.

    Args:
        draft: its meshes by their paths, as found.
        out: where the URDF will be.
        folder: for copies, in ``out``.

    Returns:
        What is to be copied.
    """
    here = out.resolve()
    elements = [mesh for *_, mesh in _meshes(draft)]
    sources = [Path(mesh.get("filename", "")).resolve() for mesh in elements]
    away = sorted({s for s in sources if not s.is_relative_to(here)})
    above = Path(os.path.commonpath([s.parent for s in away])) if away else here
    copies: Copies = {}
    for mesh, source in zip(elements, sources, strict=True):
        target = source
        if not source.is_relative_to(here):
            target = here / folder / source.relative_to(above)
            copies[target] = source
            colours = source.with_suffix(".mtl")
            if source.suffix.lower() == ".obj" and colours.is_file():
                copies[target.with_suffix(".mtl")] = colours
        mesh.set("filename", target.relative_to(here).as_posix())
    if copies:
        size = sum(source.stat().st_size for source in copies.values())
        draft.note(
            "changed",
            f"{len(copies)} meshes, {size / 1e6:.1f} MB, are copied to {folder}: files "
            "and folder can be moved together",
        )
    return copies


def check_copies(copies: Copies) -> None:
    """Refuse to put a mesh where another file is.

    Raises:
        UsageError: with the file.
    """
    for target, source in copies.items():
        if target.exists() and not filecmp.cmp(target, source, shallow=False):
            raise UsageError(
                f"{target}: is there already and is another file; take another --name "
                "or --out, or replace it with --overwrite"
            )


def copy_meshes(copies: Copies) -> None:
    """Copy them, each whole or not at all."""
    for target, source in copies.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(target) as file:
            file.write(source.read_bytes())


def _meshes(
    draft: Draft,
) -> Iterator[tuple[ElementTree.Element, ElementTree.Element, ElementTree.Element]]:
    """Link, shape and mesh of every shape that is a mesh."""
    for link in draft.root.iter("link"):
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                mesh = shape.find("geometry/mesh")
                if mesh is not None:
                    yield link, shape, mesh


def _mesh_path(name: str, urdf: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Look for a mesh where ROS would, and beside and above the URDF."""
    match = re.match(r"(?:package|model)://+(.*)", name)
    folders = [*package_dirs, *urdf.resolve().parents]
    if match is None:
        path = urdf.parent.resolve() / name.removeprefix("file://")
        return path if path.is_file() else None
    package, _, rest = match[1].partition("/")
    for folder in folders:
        places = [folder / package / rest, folder / "share" / package / rest]
        if folder.name == package:
            places.append(folder / rest)
        for path in places:
            if path.is_file():
                return path
    return None
