"""URDFs as people have them: each becomes a robot that stands, or one clear line."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from surefoot import load_scenario, simulate
from surefoot.errors import UsageError
from surefoot.robot_files.new_robot import NewRobot, NewRobotOptions, new_robot
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import load_robot
from surefoot.stabilizer.model import RobotModel
from surefoot.stabilizer.stance.nominal import stand
from surefoot.view.robot_shape import RobotShape
from tests.awkward_robot import AWKWARD, make_awkward

WALKER = load_robot("walker").urdf_path
FEET = NewRobotOptions("left_foot_plate", "right_foot_plate", name="made")
LEVEL_RAD, LEVEL_M = 1e-3, 1e-3
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
    """Add a joint with limits, and its child where there is none."""
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


def under_a_world(kind: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        ElementTree.SubElement(root, "link", name="world")
        joint(root, "to_world", kind, "world", "torso", xyz="0 0 1")

    return change


def with_a_unit_on_the_head(root: ElementTree.Element) -> None:
    part(root, "joint", "imu_mount").find("parent").set("link", "head")  # type: ignore[union-attr]


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


def endless(name: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        part(root, "joint", name).set("type", "continuous")

    return change


def with_limits(**limits: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        for limit in root.iterfind("joint/limit"):
            for key, value in limits.items():
                limit.set(key, value)

    return change


def in_degrees(root: ElementTree.Element) -> None:
    for limit in root.iterfind("joint/limit"):
        for key in ("lower", "upper"):
            limit.set(key, str(np.degrees(float(limit.get(key, "0")))))


def in_millimetres(root: ElementTree.Element) -> None:
    for element in root.iter():
        for key in ("xyz", "size", "radius", "length"):
            if key in element.attrib and element.tag != "axis":
                numbers = [1e3 * float(word) for word in element.get(key, "").split()]
                element.set(key, " ".join(map(str, numbers)))


def with_meshes_alone(root: ElementTree.Element) -> None:
    """Feet of a mesh that is a picture, in a package; all other shapes are gone."""
    for link in root.iter("link"):
        for tag in ("collision", "visual"):
            for shape in link.findall(tag):
                link.remove(shape)
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


def with_one_knee_reversed(root: ElementTree.Element) -> None:
    """As a mirrored drawing has it: the axis, and with it the range."""
    knee = part(root, "joint", "right_knee")
    knee.find("axis").set("xyz", "0 -1 0")  # type: ignore[union-attr]
    knee.find("limit").attrib.update(lower="-2.2672", upper="0.2622")  # type: ignore[union-attr]


def in_a_ring(root: ElementTree.Element) -> None:
    part(root, "joint", "left_knee").find("parent").set("link", "left_foot")  # type: ignore[union-attr]


def on_two_joints(root: ElementTree.Element) -> None:
    joint(root, "again", "fixed", "torso", "left_foot")


def without_sensor_mounts(root: ElementTree.Element) -> None:
    """As most are drawn: nothing is named like a sensor, every foot is a left_foot."""
    for side in SIDES:
        part(root, "joint", f"{side}_ankle_ft_mount").set("name", f"{side}_foot_glue")


def with_halves_of_tags(root: ElementTree.Element) -> None:
    """What Pinocchio's reader takes for broken, and nobody needs."""
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
    """The box drawn along y, and turned by 90 deg about the vertical."""
    for side in SIDES:
        for shape in part(root, "link", f"{side}_foot_plate").findall("collision"):
            box = shape.find("geometry/box")
            assert box is not None
            x, y, z = box.get("size", "").split()
            box.set("size", f"{y} {x} {z}")
            shape.find("origin").set("rpy", "0 0 1.5707963267948966")  # type: ignore[union-attr]


def with_mesh_scale(scale: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        with_meshes_alone(root)
        for mesh in root.iter("mesh"):
            mesh.set("scale", scale)

    return change


def with_mesh_file(name: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        with_meshes_alone(root)
        for mesh in root.iter("mesh"):
            mesh.set("filename", name)

    return change


def with_a_joint_called_as_a_sole(root: ElementTree.Element) -> None:
    part(root, "joint", "head_yaw").set("name", "left_foot_plate")


def with_a_skin(root: ElementTree.Element) -> None:
    """Hundreds of frames without mass, as an artificial skin has them."""
    for place in range(300):
        parent = "torso" if place % 30 == 0 else f"skin_{place - 1}"
        joint(root, f"to_skin_{place}", "fixed", parent, f"skin_{place}")


def with_xacro(root: ElementTree.Element) -> None:
    part(root, "joint", "left_knee").find("origin").set("xyz", "0 0 ${-thigh}")  # type: ignore[union-attr]


def with_knee_limit(**limits: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        knee = part(root, "joint", "left_knee")
        limit = knee.find("limit")
        assert limit is not None
        limit.attrib.update(limits)
        if not limits:
            knee.remove(limit)

    return change


def with_two_bases(root: ElementTree.Element) -> None:
    ElementTree.SubElement(root, "link", name="stand")


def with_two_of_one_name(root: ElementTree.Element) -> None:
    weigh(ElementTree.SubElement(root, "link", name="left_hand"), 0.1)


def with_a_tool(kind: str) -> Change:
    def change(root: ElementTree.Element) -> None:
        joint(root, "tool_mount", kind, "left_hand", "tool")
        weigh(part(root, "link", "tool"), 1.0)

    return change


def without_direction(root: ElementTree.Element) -> None:
    part(root, "joint", "left_elbow").find("axis").set("xyz", "0 0 0")  # type: ignore[union-attr]


def with_axes_of_zeros(root: ElementTree.Element) -> None:
    """On all joints that are fixed, as an exporter of drawings writes them."""
    for found in root.iterfind("joint[@type='fixed']"):
        ElementTree.SubElement(found, "axis", xyz="0 0 0")


def rooted_at(height: str) -> Change:
    """A frame without mass as the root, as on wheeled robots."""

    def change(root: ElementTree.Element) -> None:
        joint(root, "footprint", "fixed", "base_footprint", "torso", xyz=height)
        ElementTree.SubElement(root, "link", name="base_footprint")

    return change


def with_a_waist(root: ElementTree.Element) -> None:
    """Below the base: both legs hang on it."""
    for side in SIDES:
        part(root, "joint", f"{side}_hip_yaw").find("parent").set("link", "pelvis")  # type: ignore[union-attr]
    joint(root, "waist", "revolute", "torso", "pelvis")
    weigh(part(root, "link", "pelvis"), 3.0)


def with_weak_knees(root: ElementTree.Element) -> None:
    for side in SIDES:
        limit = part(root, "joint", f"{side}_knee").find("limit")
        assert limit is not None
        limit.set("effort", "40")


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


def check_posture(robot: NewRobot) -> None:
    model = RobotModel(robot.robot)
    standing = stand(model)
    assert standing.sole_tilt.max() < LEVEL_RAD
    assert np.abs(standing.sole_yaw).max() < LEVEL_RAD
    assert np.abs(standing.com[:2]).max() < LEVEL_M
    assert standing.soles[0, 1] > standing.soles[1, 1]
    assert standing.plates.min() > 0.0
    assert np.abs(standing.torques / robot.robot.torque_limit).max() < 1.0


STANDS: dict[str, tuple[Change, NewRobotOptions, str]] = {
    "as it is": (nothing, FEET, "inertial unit: 'imu'"),
    "world, fixed": (under_a_world("fixed"), FEET, "the base floats"),
    "world, floating": (under_a_world("floating"), FEET, "the base floats"),
    "unit on the head": (with_a_unit_on_the_head, FEET, "moves against it, by"),
    "toes": (with_toes, FEET, "below a foot"),
    "fingers": (with_fingers, FEET, "as fingers do: left_grip, right_grip"),
    "endless wrist": (endless("left_wrist_roll"), FEET, "left_wrist_roll"),
    "12 joints": (nothing, replace(FEET, legs_only=True), "as asked: head_yaw"),
    "arms fixed by pattern": (
        nothing,
        replace(FEET, fix=("*_shoulder_*", "*_wrist_*", "*_elbow")),
        "14 joints fixed",
    ),
    "no efforts": (with_limits(effort="0", velocity="0"), FEET, "torque limits of 28"),
    "no sensor": (without_sensor_mounts, FEET, "taken to sit at the ankle"),
    "meshes alone": (with_meshes_alone, FEET, "240 x 120 mm"),
    "lost pictures": (with_lost_pictures, FEET, "meshes are not there"),
    "one knee reversed": (with_one_knee_reversed, FEET, "knees at 1.28 and -1.28"),
    "impossible inertia, repaired": (
        with_impossible_inertia,
        replace(FEET, repair_inertias=True),
        "repaired: left_thigh",
    ),
    "named by its sole frames": (
        nothing,
        replace(FEET, left_sole="left_sole", right_sole="right_sole"),
        "above 'left_foot_plate', which weighs 0.456 kg",
    ),
    "halves of tags": (with_halves_of_tags, FEET, "28 joints, in the order"),
    "mimic chain": (with_a_mimic_chain, FEET, "4 joints fixed, they follow another"),
    "other letters": (
        in_other_letters,
        replace(FEET, fix=("\u9996*",)),
        "as asked: \u9996 yaw \u03c8",
    ),
    "soles turned": (with_soles_turned, FEET, "left sole: 271 x 155 mm"),
    "mesh mirrored": (with_mesh_scale("0.1 0.1 -0.1"), FEET, "240 x 120 mm"),
    "joint called as a sole": (with_a_joint_called_as_a_sole, FEET, "271 x 155 mm"),
    "skin": (with_a_skin, FEET, "28 joints, in the order"),
    "axes of zeros": (with_axes_of_zeros, FEET, "28 joints, in the order"),
    "root at the ground": (rooted_at("0 0 0.97"), FEET, "fixed to the base 'base_foo"),
    "root below": (rooted_at("0 0 1.25"), FEET, "fixed to the base 'base_footprint'"),
    "waist below the base": (with_a_waist, FEET, "both legs hang on them"),
    "weak knees": (with_weak_knees, FEET, "what a knee can carry"),
    "package of xacros": (in_a_package_of_xacros, FEET, "robot_xacro/head.stl"),
    "limits without end": (
        with_limits(effort="inf", velocity="inf"),
        FEET,
        "torque limits of 28",
    ),
}


@pytest.mark.parametrize("name", STANDS)
def test_it_becomes_a_robot(name: str, tmp_path: Path) -> None:
    change, options, told = STANDS[name]
    robot = made(tmp_path, change, options)
    check_posture(robot)
    assert told in "\n".join(note.text for note in robot.notes)


def test_frames_may_be_turned_as_they_like(tmp_path: Path) -> None:
    drawn = make_awkward(tmp_path, AWKWARD).robot.urdf_path
    robot = new_robot(drawn, FEET, out=tmp_path / "made")
    check_posture(robot)
    assert robot.robot.left.half_length_m == pytest.approx(0.1357, abs=1e-3)
    assert robot.robot.left.half_width_m == pytest.approx(0.0774, abs=1e-3)


def test_what_was_made_can_be_moved_without_its_source(tmp_path: Path) -> None:
    drawn = RobotShape(made(tmp_path, with_meshes_alone, FEET).robot).meshes
    shutil.rmtree(tmp_path / "drawn")
    folder = (tmp_path / "made").rename(tmp_path / "elsewhere")
    robot = load_robot(folder / "made.toml")
    assert str(tmp_path) not in robot.urdf_path.read_text()
    moved = RobotShape(robot).meshes
    assert moved.keys() == drawn.keys() == {"left_foot_plate", "right_foot_plate"}
    for link, mesh in moved.items():
        np.testing.assert_array_equal(mesh.vertices, drawn[link].vertices)
    (folder / "made_meshes" / "foot.obj").unlink()
    with pytest.raises(
        RobotFileError, match=r"left_foot_plate.*no such file.*foot\.obj"
    ):
        RobotShape(load_robot(folder / "made.toml"))


def test_frames_at_the_ground_are_no_fall(tmp_path: Path) -> None:
    robot = made(tmp_path, rooted_at("0 0 0.97"), FEET).robot
    assert abs(robot.file.nominal_base_height_m) < 0.1
    scenario = msgspec.structs.replace(load_scenario("tilt-ramp-roll"), duration_s=1.5)
    assert simulate(robot, scenario, record=False).outcome.is_up


def test_a_knee_that_cannot_carry_bends_less(tmp_path: Path) -> None:
    strong = made(tmp_path / "strong", nothing, FEET).robot
    for rise_m in (None, 0.005):
        weak = made(
            tmp_path / f"weak {rise_m}", with_weak_knees, replace(FEET, rise_m=rise_m)
        ).robot
        knee = weak.joint_names.index("left_knee")
        assert abs(weak.nominal[knee]) < 0.8 * abs(strong.nominal[knee])


def test_what_is_not_ours_is_never_replaced(tmp_path: Path) -> None:
    made(tmp_path, with_meshes_alone, FEET)
    mesh = tmp_path / "made" / "made_meshes" / "foot.obj"
    mesh.write_text("somebody's own")
    drawn = tmp_path / "drawn" / "drawn.urdf"
    with pytest.raises(UsageError, match=r"foot\.obj: is there already"):
        new_robot(drawn, FEET, out=tmp_path / "made", overwrite=True)
    assert mesh.read_text() == "somebody's own"


def test_what_cannot_be_written_whole_is_not_there(tmp_path: Path) -> None:
    def change(root: ElementTree.Element) -> None:
        with_meshes_alone(root)
        visual = ElementTree.SubElement(part(root, "link", "head"), "visual")
        shape = ElementTree.SubElement(visual, "geometry")
        ElementTree.SubElement(shape, "mesh", filename="pictures/head.obj")

    pictures = tmp_path / "drawn" / "pictures"
    pictures.mkdir(parents=True)
    (pictures / "head.obj").write_text(CUBE)
    own = tmp_path / "made" / "made_meshes" / "pictures"
    own.parent.mkdir(parents=True)
    own.write_text("a file of somebody's")
    with pytest.raises(FileExistsError):
        made(tmp_path, change, FEET)
    left = [path.name for path in (tmp_path / "made").rglob("*")]
    assert left == ["made_meshes", "pictures"]
    assert own.read_text() == "a file of somebody's"


def test_a_name_may_end_no_comment(tmp_path: Path) -> None:
    robot = made(tmp_path, nothing, replace(FEET, name="a--b"))
    assert robot.robot.file.name == "a--b"


REFUSED: dict[str, tuple[Change, NewRobotOptions, str]] = {
    "endless knee": (endless("left_knee"), FEET, "'left_knee' of a leg"),
    "no inertia": (without_inertia, FEET, "'left_ankle_roll' moves link 'left_foot'"),
    "no shapes": (without_shapes, FEET, "left foot, .*none of them has a shape"),
    "impossible inertia": (with_impossible_inertia, FEET, "inertia of left_thigh"),
    "sides exchanged": (
        nothing,
        replace(FEET, left_sole="right_foot_plate", right_sole="left_foot_plate"),
        "exchange --left-sole and --right-sole",
    ),
    "no such sole": (nothing, replace(FEET, left_sole="l_sole"), "left_sole"),
    "one foot twice": (
        nothing,
        replace(FEET, left_sole="left_sole", right_sole="left_foot_plate"),
        "on one foot",
    ),
    "sole above the knee": (
        nothing,
        replace(FEET, left_sole="left_thigh", right_sole="right_thigh"),
        "face|no knee|no posture",
    ),
    "unit that moves": (with_a_unit_on_the_head, replace(FEET, imu="imu"), "head_yaw"),
    "sensor elsewhere": (
        nothing,
        replace(FEET, left_ft="right_foot_plate"),
        "does not hang on it",
    ),
    "no such joint": (nothing, replace(FEET, fix=("wings",)), "no joint fits 'wings'"),
    "degrees": (in_degrees, FEET, "in degrees"),
    "millimetres": (in_millimetres, FEET, "in metres|m away"),
    "no ranges": (with_limits(lower="0", upper="0"), FEET, "lower 0 is not below"),
    "ring": (in_a_ring, FEET, "ring|two joints"),
    "two joints": (on_two_joints, FEET, "hangs on two joints"),
    "xacro": (with_xacro, FEET, "expand the xacro"),
    "no limit": (with_knee_limit(), FEET, "'left_knee' has no <limit>"),
    "limits exchanged": (
        with_knee_limit(lower="2.2", upper="-0.2"),
        FEET,
        "'left_knee': limit: lower 2.2 is not below",
    ),
    "limit of no number": (with_knee_limit(lower="nan"), FEET, "'left_knee': limit"),
    "two bases": (with_two_bases, FEET, "hangs on no joint, got 'torso', 'stand'"),
    "one name twice": (with_two_of_one_name, FEET, "two links are called 'left_hand'"),
    "planar": (with_a_tool("planar"), FEET, "'tool_mount': type 'planar'"),
    "floating tool": (with_a_tool("floating"), FEET, "'tool_mount': type 'floating'"),
    "no direction": (without_direction, FEET, "'left_elbow': axis: got 0 0 0"),
    "mesh of no size": (with_mesh_scale("0 0 0"), FEET, "left foot.*flat or empty"),
    "mesh scale in words": (with_mesh_scale("1 1"), FEET, "left foot|scale"),
    "no yaw at the hip": (
        nothing,
        replace(FEET, fix=("*_hip_yaw",)),
        "in 11 of 12 directions",
    ),
    "rooted in a sole": (nothing, replace(FEET, left_sole="torso"), "whose root is"),
    "turn of no number": (with_a_turn_of_no_number, FEET, "'tool': origin: rpy"),
    "mesh that is not there": (
        with_mesh_file("feet/lost.stl"),
        FEET,
        r"feet/lost\.stl is not there; .*--package-dir",
    ),
    "mesh that is none": (with_mesh_file("feet/page.stl"), FEET, "left_foot_plate"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    change, options, told = REFUSED[name]
    with pytest.raises(RobotFileError, match=told) as refused:
        made(tmp_path, change, options)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "made").exists()
