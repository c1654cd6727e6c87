"""A URDF under work: links, joints and meshes, and notes on what was done."""

from __future__ import annotations

import difflib
import filecmp
import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple
from urllib.parse import unquote

import numpy as np

from surefoot.errors import UsageError
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.urdf_check import (
    UNUSED_TAGS,
    drop,
    end,
    joints_above,
    read_urdf_element,
)
from surefoot.schemas.arrays import Mat, Vec3
from surefoot.schemas.toml_file import atomic_file

KEPT_TAGS = ("link", "joint", "material")

NoteKind = Literal["found", "guessed", "changed", "left to you"]
KINDS: tuple[NoteKind, ...] = ("found", "changed", "guessed", "left to you")
_MOST_NAMES = 12


class Note(NamedTuple):
    """One line of the report.

    Attributes:
        kind: found in the URDF, guessed, changed, or left to the user.
        text: what it is, with names.
    """

    kind: NoteKind
    text: str


class Draft:
    """The tree of a URDF, changed in place.

    Attributes:
        path: path of the URDF.
        root: its <robot> element.
        notes: lines of the report.
        lost: name of a missing mesh, by link.
    """

    def __init__(self, path: Path) -> None:
        """Read a URDF; only links, joints and materials are kept.

        Raises:
            RobotFileError: it is no URDF, or its links form no tree.
        """
        self.path = path
        self.root = read_urdf_element(path)
        self.notes: list[Note] = []
        self.lost: dict[str, str] = {}
        if self.root.tag != "robot":
            hint = "; expand the xacro first" if "xacro" in path.suffix else ""
            raise RobotFileError(
                f"{path}: begins with <{self.root.tag}>, expected <robot>{hint}"
            )
        self._check_expanded()
        for element in list(self.root):
            if element.tag not in KEPT_TAGS:
                self.root.remove(element)
        for joint in self.root.findall("joint"):
            drop(joint, UNUSED_TAGS)
        joints_above(path, self.links, self.root.findall("joint"))

    def note(self, kind: NoteKind, text: str) -> None:
        """Add a line to the report."""
        self.notes.append(Note(kind, text))

    @property
    def joints(self) -> dict[str, ElementTree.Element]:
        """All joints by name."""
        return {j.get("name", ""): j for j in self.root.findall("joint")}

    @property
    def links(self) -> dict[str, ElementTree.Element]:
        """All links by name."""
        return {link.get("name", ""): link for link in self.root.findall("link")}

    @property
    def above(self) -> dict[str, ElementTree.Element]:
        """The joint above each link, by name of the link."""
        return {end(j, "child"): j for j in self.root.findall("joint")}

    @property
    def base(self) -> str:
        """The link without a joint above it."""
        above = self.above
        return next(name for name in self.links if name not in above)

    def chain(self, link: str) -> list[ElementTree.Element]:
        """Return the joints above a link, the nearest first."""
        above, found = self.above, []
        while (joint := above.get(link)) is not None:
            found.append(joint)
            link = end(joint, "parent")
        return found

    def below(self, link: str) -> list[str]:
        """Return a link and all links below it."""
        children: dict[str, list[str]] = {}
        for joint in self.root.findall("joint"):
            children.setdefault(end(joint, "parent"), []).append(end(joint, "child"))
        found = [link]
        for name in found:
            found += children.get(name, [])
        return found

    def carried_kg(self, joint: ElementTree.Element) -> float:
        """Return the mass below a joint [kg]; unreadable masses count as zero."""
        links = self.links
        return sum(mass_of(links[name]) for name in self.below(end(joint, "child")))

    @property
    def mass_kg(self) -> float:
        """Mass of all links [kg]."""
        return sum(mass_of(link) for link in self.links.values())

    def find_link(self, name: str, *, option: str) -> str:
        """Return the name of a link given by the user.

        Raises:
            RobotFileError: there is no such link; names the nearest ones.
        """
        links = list(self.links)
        if name in links:
            return name
        near = difflib.get_close_matches(name, links, n=3, cutoff=0.4)
        words = ("foot", "sole", "ankle", "imu")
        near = near or [n for n in links if any(w in n.lower() for w in words)][:8]
        hint = f"; there is {', '.join(near)}" if near else ""
        raise RobotFileError(f"{self.path}: {option}: no link {name!r}{hint}")

    def fix(self, joint: ElementTree.Element) -> None:
        """Make a joint fixed at zero, or at the end of its range nearest to zero."""
        from scipy.spatial.transform import Rotation

        limit = joint.find("limit")
        angle = 0.0
        if limit is not None and joint.get("type") == "revolute":
            lower, upper = (_number(limit.get(key)) for key in ("lower", "upper"))
            angle = min(max(0.0, lower), upper) if lower <= upper else 0.0
        axis = _triple(joint.find("axis"), "xyz", "1 0 0")
        turned = _triple(joint.find("origin"), "rpy")
        if angle and np.isfinite((axis, turned)).all():  # others are refused later
            place = Rotation.from_euler("xyz", turned)
            length = float(np.linalg.norm(axis)) or 1.0  # zero axes are refused later
            turn = Rotation.from_rotvec(angle * axis / length)
            write_origin(
                joint,
                _triple(joint.find("origin"), "xyz"),
                (place * turn).as_matrix(),
            )
        joint.set("type", "fixed")
        drop(joint, ("limit", "mimic", "dynamics", "axis"))

    def add_frame(self, name: str, *, parent: str, place: Vec3, R: Mat) -> str:
        """Add a link without mass, fixed to another link.

        Args:
            name: wanted name; ``_frame`` is added while it is taken.
            parent: link that it is fixed to.
            place: (3,) position in the parent [m].
            R: (3, 3) parent from frame.

        Returns:
            The link's name.
        """
        taken = {*self.links, *self.joints}
        while name in taken or f"{name}_joint" in taken:
            name += "_frame"
        ElementTree.SubElement(self.root, "link", name=name)
        joint = ElementTree.SubElement(
            self.root, "joint", name=f"{name}_joint", type="fixed"
        )
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=name)
        write_origin(joint, place, R)
        return name

    def text(self) -> str:
        """Return the present URDF."""
        ElementTree.indent(self.root)
        return ElementTree.tostring(self.root, encoding="unicode") + "\n"

    def _check_expanded(self) -> None:
        """Refuse a URDF with xacro expressions."""
        for element in self.root.iter():
            tag, values = str(element.tag), element.attrib.values()
            left = [word for word in values if "${" in word or "$(" in word]
            if "xacro" in tag:
                left.insert(0, tag)
            if left:
                raise RobotFileError(
                    f"{self.path}: <{str(element.tag).rpartition('}')[2]}> holds "
                    f"{left[0][:60]!r}: expand the xacro first, xacro FILE > robot.urdf"
                )


def listed(names: list[str]) -> str:
    """Return names as a list in words, shortened when there are many."""
    shown = ", ".join(names[:_MOST_NAMES])
    more = len(names) - _MOST_NAMES
    return f"{shown} and {more} more" if more > 0 else shown


def write_origin(element: ElementTree.Element, place: Vec3, R: Mat) -> None:
    """Set a joint's place on its parent.

    Args:
        element: the joint.
        place: (3,) position in the parent link [m].
        R: (3, 3) parent link from joint.
    """
    from scipy.spatial.transform import Rotation

    origin = element.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(element, "origin")
    angles = Rotation.from_matrix(R).as_euler("xyz")
    for key, values in (("xyz", place), ("rpy", angles)):
        origin.set(key, " ".join(f"{float(v) + 0.0:.9g}" for v in values))


def mass_of(link: ElementTree.Element) -> float:
    """Return the mass of a link [kg]; zero if it cannot be read."""
    element = link.find("inertial/mass")
    return 0.0 if element is None else _number(element.get("value"))


def _number(text: str | None) -> float:
    """Return a number; zero if it is none, which is refused later with its place."""
    try:
        return float(text or 0.0)
    except ValueError:
        return 0.0


def _triple(
    element: ElementTree.Element | None, key: str, default: str = "0 0 0"
) -> Vec3:
    text = default if element is None else element.get(key, default)
    numbers = np.array([_number(word) for word in text.split()])
    return numbers if len(numbers) == 3 else np.zeros(3)


Copies = dict[Path, Path]
"""Source path of each file to copy, by target path."""


def find_meshes(draft: Draft, package_dirs: Sequence[Path]) -> None:
    """Set every mesh's path; shapes whose mesh is missing are removed."""
    lost: list[str] = []
    for link, shape, mesh in list(_meshes(draft)):
        name = mesh.get("filename", "")
        found = _mesh_path(name, draft.path, package_dirs)
        if found is None:
            link.remove(shape)
            lost.append(name)
            draft.lost.setdefault(link.get("name", ""), name)
        else:
            mesh.set("filename", str(found))
    if lost:
        draft.note(
            "left to you",
            f"mesh files that are not there were left out: {len(lost)}, such as "
            f"{lost[0]}; name their folder with --package-dir",
        )


def carry_meshes(draft: Draft, out: Path, *, folder: str) -> Copies:
    """Make all mesh paths relative to the new URDF, so that both can be moved.

    Meshes below the new URDF's folder stay. All others are to be copied into one
    folder. They keep their relative places, since they may refer to each other.

    Returns:
        Files to copy.
    """
    here = out.resolve()
    elements = [mesh for *_, mesh in _meshes(draft)]
    sources = [_in_its_folder(Path(mesh.get("filename", ""))) for mesh in elements]
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
            f"mesh files copied to {folder}: {len(copies)}, {size / 1e6:.1f} MB; files "
            "and folder can be moved together",
        )
    return copies


def _in_its_folder(path: Path) -> Path:
    """Return an absolute path; a symbolic link keeps its own name."""
    return path.parent.resolve() / path.name


def check_copies(copies: Copies) -> None:
    """Refuse to replace a different file at a target, which may be the user's.

    Raises:
        UsageError: names the file.
    """
    for target, source in copies.items():
        if target.exists() and not filecmp.cmp(target, source, shallow=False):
            raise UsageError(
                f"{target}: is there already and is another file; move it away, or "
                "take another --name or --out"
            )


def copy_meshes(copies: Copies) -> None:
    """Copy the files, each completely or not at all."""
    for target, source in copies.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(target) as file:
            file.write(source.read_bytes())


def _meshes(
    draft: Draft,
) -> Iterator[tuple[ElementTree.Element, ElementTree.Element, ElementTree.Element]]:
    """Yield link, shape and mesh of every shape with a mesh."""
    for link in draft.root.iter("link"):
        for tag in ("visual", "collision"):
            for shape in link.findall(tag):
                mesh = shape.find("geometry/mesh")
                if mesh is not None:
                    yield link, shape, mesh


def _mesh_path(name: str, urdf: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Find a mesh by its name, which may be a URI with ``%20`` for a blank."""
    places = (_mesh_called(n, urdf, package_dirs) for n in (name, unquote(name)))
    return next(filter(None, places), None)


def _mesh_called(name: str, urdf: Path, package_dirs: Sequence[Path]) -> Path | None:
    """Find a mesh where ROS looks, and beside and above the URDF."""
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
