"""The Walker's URDF, changed to forms that users have, and robots made of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

from surefoot.robot_files.new_robot import NewRobot, NewRobotOptions, new_robot
from surefoot.robot_io.robot import load_robot

WALKER = load_robot("walker").urdf_path
FEET = NewRobotOptions("left_foot_plate", "right_foot_plate", name="made")
Change = Callable[[ElementTree.Element], None]
SIDES = ("left", "right")


def part(root: ElementTree.Element, tag: str, name: str) -> ElementTree.Element:
    (found,) = root.findall(f"{tag}[@name='{name}']")
    return found


def joint(
    root: ElementTree.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    *,
    xyz: str = "0 0 0",
) -> ElementTree.Element:
    """Add a joint with limits; its child link is added if missing."""
    if root.find(f"link[@name='{child}']") is None:
        ElementTree.SubElement(root, "link", name=child)
    made = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(made, "origin", xyz=xyz, rpy="0 0 0")
    ElementTree.SubElement(made, "parent", link=parent)
    ElementTree.SubElement(made, "child", link=child)
    if kind not in ("fixed", "floating"):
        ElementTree.SubElement(made, "axis", xyz="0 1 0")
        ElementTree.SubElement(
            made, "limit", lower="-0.5", upper="0.5", effort="10", velocity="5"
        )
    return made


def weigh(link: ElementTree.Element, mass: float) -> None:
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "mass", value=str(mass))
    small = str(mass * 1e-3)
    zero = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    ElementTree.SubElement(inertial, "inertia", ixx=small, iyy=small, izz=small, **zero)


def altered(name: str, tag: str = "", /, **attributes: str) -> Change:
    """Return a change of attributes of a joint, or of its element with a tag."""

    def change(root: ElementTree.Element) -> None:
        found = part(root, "joint", name).find(tag or ".")
        assert found is not None
        found.attrib.update(attributes)

    return change


def both(*changes: Change) -> Change:
    """Return one change after the other."""

    def change(root: ElementTree.Element) -> None:
        for each in changes:
            each(root)

    return change


def under_a_world(kind: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        ElementTree.SubElement(root, "link", name="world")
        joint(root, "to_world", kind, "world", "torso", xyz="0 0 1")

    return change


def with_a_link_called(link: str, name: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        part(root, "link", link).set("name", name)
        for end in root.iterfind(f"joint/*[@link='{link}']"):
            end.set("link", name)

    return change


def without_a_name(root: ElementTree.Element) -> None:
    del root.attrib["name"]


def with_toes(root: ElementTree.Element) -> None:
    for side in SIDES:
        joint(
            root, f"{side}_toe", "revolute", f"{side}_foot_plate", f"{side}_toes",
            xyz="0.1 0 -0.06",
        )  # fmt: skip
        weigh(part(root, "link", f"{side}_toes"), 0.2)


def with_fingers(root: ElementTree.Element) -> None:
    for side in SIDES:
        joint(root, f"{side}_grip", "revolute", f"{side}_hand", f"{side}_finger")
        tip = joint(root, f"{side}_tip", "revolute", f"{side}_finger", f"{side}_nail")
        ElementTree.SubElement(tip, "mimic", joint=f"{side}_grip", multiplier="1")
        for link in ("finger", "nail"):
            weigh(part(root, "link", f"{side}_{link}"), 0.1)


def with_limits(**limits: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        for limit in root.iterfind("joint/limit"):
            for key, value in limits.items():
                limit.set(key, value)

    return change


def in_millimetres(root: ElementTree.Element) -> None:
    for element in root.iter():
        for key in ("xyz", "size", "radius", "length"):
            if key in element.attrib and element.tag != "axis":
                numbers = [1e3 * float(word) for word in element.get(key, "").split()]
                element.set(key, " ".join(map(str, numbers)))


def with_meshes_alone(root: ElementTree.Element) -> None:
    """Give feet a visual mesh in a package, and remove all other shapes."""
    without_shapes(root)
    for side in SIDES:
        visual = ElementTree.SubElement(
            part(root, "link", f"{side}_foot_plate"), "visual"
        )
        ElementTree.SubElement(visual, "origin", xyz="0.02 0 -0.05", rpy="1.5708 0 0")
        geometry = ElementTree.SubElement(visual, "geometry")
        ElementTree.SubElement(
            geometry, "mesh", filename="package://feet/foot.obj", scale="0.1 0.1 0.1"
        )


def with_lost_pictures(root: ElementTree.Element) -> None:
    for link in root.iter("link"):
        for geometry in link.findall("visual/geometry"):
            geometry[:] = []
            ElementTree.SubElement(geometry, "mesh", filename="package://gone/a.stl")


def without_shapes(root: ElementTree.Element) -> None:
    for link in root.iter("link"):
        for tag in ("collision", "visual"):
            for shape in link.findall(tag):
                link.remove(shape)


def without_inertia(root: ElementTree.Element) -> None:
    for name in ("left_foot", "left_foot_plate"):
        link = part(root, "link", name)
        for inertial in link.findall("inertial"):
            link.remove(inertial)


def with_impossible_inertia(root: ElementTree.Element) -> None:
    tensor = part(root, "link", "left_thigh").find("inertial/inertia")
    assert tensor is not None
    tensor.set("izz", "9.0")


def on_two_joints(root: ElementTree.Element) -> None:
    joint(root, "again", "fixed", "torso", "left_foot")


with_one_knee_reversed = both(
    altered("right_knee", "axis", xyz="0 -1 0"),
    altered("right_knee", "limit", lower="-2.2672", upper="0.2622"),
)
"""As in a mirrored drawing: the axis is reversed, and so is the range."""
without_sensor_mounts = both(
    *(altered(f"{s}_ankle_ft_mount", name=f"{s}_foot_glue") for s in SIDES)
)
"""As in most URDFs: no link is named like a sensor, and feet are ``left_foot``."""
with_weak_knees = both(*(altered(f"{s}_knee", "limit", effort="40") for s in SIDES))


def with_halves_of_tags(root: ElementTree.Element) -> None:
    """Add incomplete elements that Pinocchio refuses and nobody needs."""
    for moved in root.findall("joint"):
        ElementTree.SubElement(moved, "calibration", rising="low")
        ElementTree.SubElement(moved, "safety_controller", soft_lower_limit="-1")


def with_a_mimic_chain(root: ElementTree.Element) -> None:
    leader, above = "left_grip", "left_hand"
    for place in range(4):
        name = f"left_grip_{place}"
        follower = joint(root, name, "revolute", above, f"left_finger_{place}")
        ElementTree.SubElement(follower, "mimic", joint=leader)
        weigh(part(root, "link", f"left_finger_{place}"), 0.05)
        leader, above = name, f"left_finger_{place}"


def in_other_letters(root: ElementTree.Element) -> None:
    part(root, "joint", "head_yaw").set("name", "\u9996 yaw \u03c8")
    part(root, "link", "head").set("name", "t\u00eate/1")
    for end in root.iterfind("joint/*[@link='head']"):
        end.set("link", "t\u00eate/1")


def with_soles_turned(root: ElementTree.Element) -> None:
    """Draw the sole's box along y, turned by 90 deg about the vertical."""
    for side in SIDES:
        for shape in part(root, "link", f"{side}_foot_plate").findall("collision"):
            box = shape.find("geometry/box")
            assert box is not None
            x, y, z = box.get("size", "").split()
            box.set("size", f"{y} {x} {z}")
            shape.find("origin").set("rpy", "0 0 1.5707963267948966")  # type: ignore[union-attr]


def with_meshes(**attributes: str) -> Change:
    """Like ``with_meshes_alone``, with another report."""

    def change(root: ElementTree.Element) -> None:
        with_meshes_alone(root)
        for mesh in root.iter("mesh"):
            mesh.attrib.update(attributes)

    return change


def with_a_skin(root: ElementTree.Element) -> None:
    """Add hundreds of frames without mass, as artificial skins have."""
    for place in range(300):
        parent = "torso" if place % 30 == 0 else f"skin_{place - 1}"
        joint(root, f"to_skin_{place}", "fixed", parent, f"skin_{place}")


def with_two_bases(root: ElementTree.Element) -> None:
    ElementTree.SubElement(root, "link", name="stand")


def with_axes_of_zeros(root: ElementTree.Element) -> None:
    """Set zero axes on all fixed joints, as a CAD exporter writes them."""
    for found in root.iterfind("joint[@type='fixed']"):
        ElementTree.SubElement(found, "axis", xyz="0 0 0")


def rooted_at(height: str) -> Change:
    """Add a frame without mass as the root, as on wheeled robots."""

    def change(root: ElementTree.Element) -> None:
        joint(root, "footprint", "fixed", "base_footprint", "torso", xyz=height)
        ElementTree.SubElement(root, "link", name="base_footprint")

    return change


def with_a_waist(root: ElementTree.Element) -> None:
    """Add a joint below the base that carries both legs."""
    for side in SIDES:
        part(root, "joint", f"{side}_hip_yaw").find("parent").set("link", "pelvis")  # type: ignore[union-attr]
    joint(root, "waist", "revolute", "torso", "pelvis")
    weigh(part(root, "link", "pelvis"), 3.0)


def in_a_package_of_xacros(root: ElementTree.Element) -> None:
    with_lost_pictures(root)
    for mesh in root.iter("mesh"):
        mesh.set("filename", "package://robot_xacro/head.stl")


def with_a_turn_of_no_number(root: ElementTree.Element) -> None:
    joint(root, "tool", "fixed", "left_hand", "tool_frame")
    part(root, "joint", "tool").find("origin").set("rpy", "0 nan 0")  # type: ignore[union-attr]


def nothing(root: ElementTree.Element) -> None:
    del root


CUBE = "\n".join(
    [f"v {x} {y} {z}" for x in (-1.2, 1.2) for y in (-0.2, 0.2) for z in (-0.6, 0.6)]
    + ["f 1 2 3", "f 2 4 3", "f 5 7 6", "f 6 7 8", "f 1 5 2", "f 2 5 6"]
    + ["f 3 4 7", "f 4 8 7", "f 1 3 5", "f 3 7 5", "f 2 6 4", "f 4 6 8"]
)


def made(tmp_path: Path, change: Change, options: NewRobotOptions) -> NewRobot:
    tree = ElementTree.parse(WALKER)
    change(tree.getroot())
    folder = tmp_path / "drawn"
    (folder / "feet").mkdir(parents=True)
    (folder / "feet" / "foot.obj").write_text(CUBE)
    (folder / "feet" / "page.stl").write_text("<html>Git LFS</html>")
    tree.write(folder / "drawn.urdf")
    return new_robot(folder / "drawn.urdf", options, out=tmp_path / "made")
