"""Checks a URDF by itself: a tree of links that MuJoCo and Pinocchio accept.

Their own errors come later, from other places, and name no link. So these checks look
for everything that they would refuse or misunderstand.
"""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path

import numpy as np

from surefoot.robot_io.errors import RobotFileError
from surefoot.schemas.arrays import Mat, Vec3

MOVABLE = ("revolute", "prismatic")
_FIXED = "fixed"
_OTHERS = {
    "continuous": "make it revolute, with a <limit> of lower, upper and effort",
    "planar": "only revolute, prismatic and fixed joints are known",
    "floating": "leave it out: the base floats by itself",
}
UNUSED_TAGS = ("calibration", "safety_controller")
"""Tags of joints that nothing here reads; Pinocchio refuses incomplete ones."""
_TAKEN = ("root_joint", "universe")
"""Names of joints that Pinocchio adds itself."""
_GROUND = "world"
"""MuJoCo's name for what stands still."""
_LEAST_MASS_KG, _LARGEST_MASS_KG = 0.1, 1000.0
LARGEST_ANGLE_RAD = 4.0 * math.pi
"""Largest angle of a joint range [rad]; larger ones are in degrees."""
_LARGEST_GYRATION_M = 3.0
"""Largest radius of gyration [m]; larger inertia for its mass has other units."""
_SHARE = 1e-6
"""Allowance for rounding in a file, as a share of the largest principal inertia."""
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
"""Attributes of <inertia>."""


class Urdf:
    """A URDF whose links form a tree and whose numbers are plausible."""

    def __init__(self, path: Path, element: ElementTree.Element | None = None) -> None:
        """Read and check a URDF.

        Args:
            path: path of the file.
            element: its <robot>, if it was read or changed before.

        Raises:
            RobotFileError: names link or joint, the fault and what is expected.
        """
        self.path = path
        element = read_urdf_element(path) if element is None else element
        if element.tag != "robot":
            raise self.refused(f"begins with <{element.tag}>, expected <robot>")
        self.links = self._named(element, "link")
        self.joints = self._named(element, "joint")
        self._above = joints_above(path, self.links, self.joints.values())
        self.root = next(link for link in self.links if link not in self._above)
        if _GROUND in self.links and self._moves(_GROUND):
            raise self.refused(
                f"link {_GROUND!r} stands for the ground and cannot move; rename it if "
                "it is the robot's, or take it out together with what is not"
            )
        for name, joint in self.joints.items():
            self._check_joint(name, joint)
        self._masses = {
            name: self._checked_mass(name, link) for name, link in self.links.items()
        }

    def refused(self, words: str) -> RobotFileError:
        """Return an error that names the file."""
        return RobotFileError(f"{self.path}: {words}")

    def joint_above(self, link: str) -> ElementTree.Element | None:
        """Return the joint that carries a link; None for the root."""
        return self._above.get(link)

    def _moves(self, link: str) -> bool:
        joint = self.joint_above(link)
        return joint is None or joint.get("type") != _FIXED

    def up(self, link: str) -> list[str]:
        """Return a link and all links above it, the root last."""
        chain = [link]
        while (joint := self.joint_above(chain[-1])) is not None:
            chain.append(end(joint, "parent"))
        return chain

    def origin(self, joint: ElementTree.Element) -> tuple[Vec3, Mat]:
        """Return a joint's place [m] and (3, 3) orientation in its parent link."""
        element = joint.find("origin")
        place = f"joint {joint.get('name')!r}: origin"
        offset = self.vector(element, "xyz", place)
        roll, pitch, yaw = self.vector(element, "rpy", place)
        x, y, z = np.eye(3)
        return offset, rotation(z, yaw) @ rotation(y, pitch) @ rotation(x, roll)

    def fixed_to(self, link: str) -> list[str]:
        """Return a link, and the links above it that do not move relative to it."""
        chain = [link]
        while (joint := self.joint_above(chain[-1])) is not None:
            if joint.get("type") != _FIXED:
                break
            chain.append(end(joint, "parent"))
        return chain

    def mass_of(self, link: str) -> float:
        """Return the mass of one link [kg]; zero if it has none."""
        return self._masses[link]

    def check_masses(self) -> None:
        """Refuse moving links without mass, and robots in other units.

        Raises:
            RobotFileError: names the link without mass, or the implausible total.
        """
        groups: Counter[str] = Counter()
        for link in self.links:
            groups[self.fixed_to(link)[-1]] += self.mass_of(link)  # type: ignore[assignment]
        for top, mass in groups.items():
            if mass > 0.0:
                continue
            joint = self._above.get(top)
            what = (
                "the base is" if joint is None else f"joint {joint.get('name')!r} moves"
            )
            raise self.refused(
                f"{what} link {top!r}, which has no mass, nor has what is fixed to "
                "it; give it an <inertial>"
            )
        total = sum(groups.values())
        if not _LEAST_MASS_KG <= total <= _LARGEST_MASS_KG:
            raise self.refused(
                f"the links weigh {total:g} together, expected {_LEAST_MASS_KG:g} to "
                f"{_LARGEST_MASS_KG:g} kg; are masses in kg?"
            )

    def pose_below_root(self, link: str, posture: dict[str, float]) -> tuple[Vec3, Mat]:
        """Return place and orientation of a link in the root's frame.

        Args:
            link: name of the link.
            posture: angle [rad] or place [m] by joint; joints not named are at zero.

        Returns:
            Place (3,) [m] and orientation (3, 3).
        """
        turned, p = np.eye(3), np.zeros(3)
        for below in reversed(self.up(link)):
            joint = self.joint_above(below)
            if joint is None:
                continue
            offset, turn = self.origin(joint)
            p, turned = p + turned @ offset, turned @ turn
            if joint.get("type") == _FIXED:  # its axis, if any, means nothing
                continue
            moved = posture.get(str(joint.get("name")), 0.0)
            axis = self.axis(joint)
            if joint.get("type") == "prismatic":
                p = p + turned @ axis * moved
            else:
                turned = turned @ rotation(axis, moved)
        return p, turned

    def _named(
        self, root: ElementTree.Element, tag: str
    ) -> dict[str, ElementTree.Element]:
        found: dict[str, ElementTree.Element] = {}
        for element in root.findall(tag):
            name = element.get("name", "")
            if not name.strip():
                raise self.refused(f"a <{tag}> without a name; give it one")
            if name in found:
                raise self.refused(f"two {tag}s are called {name!r}; rename one")
            found[name] = element
        if not found:
            raise self.refused(f"no <{tag}> in it; is it the URDF of a robot?")
        return found

    def _check_joint(self, name: str, joint: ElementTree.Element) -> None:
        place, kind = f"joint {name!r}", joint.get("type", "")
        if kind not in (*MOVABLE, _FIXED):
            advice = _OTHERS.get(kind, f"expected {', '.join(MOVABLE)} or {_FIXED}")
            raise self.refused(f"{place}: type {kind!r}; {advice}")
        if joint.find("mimic") is not None:
            raise self.refused(
                f"{place}: follows another joint (<mimic>), which is not known; make "
                "it fixed, or a joint of its own"
            )
        self.origin(joint)
        if kind == _FIXED:
            return
        if name in _TAKEN:
            raise self.refused(
                f"{place}: the name is taken, as Pinocchio adds a joint called so; "
                "rename it"
            )
        self.axis(joint)
        limit = joint.find("limit")
        if limit is None:
            raise self.refused(
                f"{place} has no <limit>, expected one with lower, upper, effort and "
                "velocity"
            )
        ends = [
            self.number(limit, key, f"{place}: limit") for key in ("lower", "upper")
        ]
        if not ends[0] < ends[1]:
            raise self.refused(
                f"{place}: limit: lower {ends[0]:g} is not below upper {ends[1]:g}"
            )
        if kind == "revolute" and max(map(abs, ends)) > LARGEST_ANGLE_RAD:
            raise self.refused(
                f"{place}: limit: from {ends[0]:g} to {ends[1]:g} rad; is it in "
                "degrees? Write radians"
            )
        for key, unit in (("effort", "N m"), ("velocity", "rad/s")):
            if self.number(limit, key, f"{place}: limit") <= 0.0:
                raise self.refused(f"{place}: limit: {key} must be above 0 ({unit})")

    def axis(self, joint: ElementTree.Element) -> Vec3:
        """Return the unit direction of a joint's axis, (3,)."""
        place = f"joint {joint.get('name')!r}: axis"
        axis = self.vector(joint.find("axis"), "xyz", place, default="1 0 0")
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise self.refused(f"{place}: got 0 0 0, expected a direction")
        return axis / length

    def _checked_mass(self, name: str, link: ElementTree.Element) -> float:
        element = link.find("inertial")
        if element is None:
            return 0.0
        place = f"link {name!r}: inertial"
        for part in ("xyz", "rpy"):
            self.vector(element.find("origin"), part, f"{place}: origin")
        mass_element, tensor = element.find("mass"), element.find("inertia")
        if mass_element is None:
            raise self.refused(f"{place}: no <mass> in it")
        mass = self.number(mass_element, "value", f"{place}: mass")
        if mass < 0.0:
            raise self.refused(f"{place}: mass {mass:g} is negative; expected kg")
        if tensor is None:
            if mass == 0.0:
                return 0.0
            raise self.refused(f"{place}: no <inertia> in it, but a mass of {mass:g}")
        xx, yy, zz, xy, xz, yz = (
            self.number(tensor, key, f"{place}: inertia") for key in INERTIA
        )
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if mass > 0.0:
            self._check_inertia(place, mass, inertia)
        return mass

    def _check_inertia(self, place: str, mass: float, inertia: Mat) -> None:
        a, b, c = np.linalg.eigvalsh(inertia)  # in rising order
        told = f"{place}: principal inertias {a:.4g}, {b:.4g}, {c:.4g}"
        if a <= 0.0:
            raise self.refused(f"{told}; all must be above 0 (kg m^2)")
        if a + b < c * (1.0 - _SHARE):
            raise self.refused(
                f"{told}: no body has these, as the two small ones must reach the "
                "large one together; check signs and units (kg m^2)"
            )
        gyration_m = math.sqrt(c / mass)
        if gyration_m > _LARGEST_GYRATION_M:
            raise self.refused(
                f"{told} for {mass:g} kg, as if it lay {gyration_m:.3g} m away; is the "
                "inertia in kg m^2 about the centre of mass?"
            )

    def number(self, element: ElementTree.Element, key: str, place: str) -> float:
        """Return one finite number of an element.

        Raises:
            RobotFileError: it is no finite number.
        """
        return float(self._numbers(element.get(key, ""), key, 1, place)[0])

    def vector(
        self,
        element: ElementTree.Element | None,
        key: str,
        place: str,
        *,
        default: str = "0 0 0",
    ) -> Vec3:
        """Return three finite numbers of an element, or the default if it is absent.

        Raises:
            RobotFileError: they are not three finite numbers.
        """
        text = default if element is None else element.get(key, default)
        return self._numbers(text, key, 3, place)

    def _numbers(self, text: str, key: str, count: int, place: str) -> Vec3:
        try:
            numbers = np.array([float(word) for word in text.split()])
        except ValueError:
            numbers = np.empty(0)
        if len(numbers) != count or not np.all(np.isfinite(numbers)):
            what = "a number" if count == 1 else f"{count} numbers"
            raise self.refused(f"{place}: {key}: got {text[:60]!r}, expected {what}")
        return numbers


def without_shapes(path: Path) -> str:
    """Return the text of a checked URDF, without shapes and unused tags.

    Meshes need not exist, and a mistake in a colour stops no controller.
    """
    return bare_text(read_urdf_element(path))


def drop(element: ElementTree.Element, tags: Iterable[str]) -> None:
    """Remove the children with these tags."""
    for found in [e for tag in tags for e in element.findall(tag)]:
        element.remove(found)


def bare_text(element: ElementTree.Element) -> str:
    """Return the same text of a URDF already read; leave the element unchanged."""
    root = copy.deepcopy(element)
    for link in root.iter("link"):
        drop(link, ("visual", "collision"))
    for joint in root.iter("joint"):
        drop(joint, UNUSED_TAGS)
    drop(root, ("material",))
    return ElementTree.tostring(root, encoding="unicode")


def read_urdf_element(path: Path) -> ElementTree.Element:
    """Read the XML of a URDF; a robot without a name gets its file's.

    Raises:
        RobotFileError: there is no such file, or it is no XML.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise RobotFileError(f"{path}: cannot be read ({error.strerror})") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise RobotFileError(f"{path}: not valid XML: {error}") from error
    root.set("name", root.get("name") or path.stem)  # Pinocchio reads none without
    return root


def joints_above(
    path: Path, links: Collection[str], joints: Iterable[ElementTree.Element]
) -> dict[str, ElementTree.Element]:
    """Return the joint that carries each link but the root, by link.

    Raises:
        RobotFileError: the links form no tree; names the file and the fault.
    """
    above: dict[str, ElementTree.Element] = {}
    for joint in joints:
        for which in ("parent", "child"):
            link = end(joint, which)
            if link not in links:
                raise RobotFileError(
                    f"{path}: joint {joint.get('name')!r}: {which} is link {link!r}, "
                    "which is not there"
                )
        other = above.setdefault(end(joint, "child"), joint)
        if other is not joint:
            raise RobotFileError(
                f"{path}: link {end(joint, 'child')!r} hangs on two joints, "
                f"{other.get('name')!r} and {joint.get('name')!r}; a robot's links "
                "must form a tree"
            )
    roots = [link for link in links if link not in above]
    if len(roots) != 1:
        names = ", ".join(map(repr, roots)) or "none: they form a ring"
        raise RobotFileError(
            f"{path}: expected one link that hangs on no joint, got {names}"
        )
    for link in links:
        seen, top = {link}, link
        while top in above:
            top = end(above[top], "parent")
            if top in seen:
                raise RobotFileError(
                    f"{path}: link {link!r} hangs on itself, in a ring"
                )
            seen.add(top)
    return above


def end(joint: ElementTree.Element, which: str) -> str:
    """Return the name of a joint's parent or child link."""
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def rotation(axis: Vec3, angle: float) -> Mat:
    """Return the rotation by an angle [rad] about a unit axis, (3, 3) (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Mat = np.eye(3) + np.sin(angle) * cross
    turned += (1.0 - np.cos(angle)) * (cross @ cross)
    return turned
