"""The files of new-robot are whole, its own, and independent of the URDF's place."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import UsageError
from surefoot.robot_files.new_robot import new_robot
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.robot import load_robot
from surefoot.view.robot_shape import RobotShape
from tests.surefoot.robot_files import changed_urdfs as urdf
from tests.surefoot.robot_files.changed_urdfs import FEET, made


def test_what_was_made_can_be_moved_without_its_source(tmp_path: Path) -> None:
    drawn = RobotShape(made(tmp_path, urdf.with_meshes_alone, FEET).robot).meshes
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


def test_what_is_not_ours_is_never_replaced(tmp_path: Path) -> None:
    made(tmp_path, urdf.with_meshes_alone, FEET)
    mesh = tmp_path / "made" / "made_meshes" / "foot.obj"
    mesh.write_text("somebody's own")
    drawn = tmp_path / "drawn" / "drawn.urdf"
    with pytest.raises(UsageError, match=r"foot\.obj: is there already"):
        new_robot(drawn, FEET, out=tmp_path / "made", overwrite=True)
    assert mesh.read_text() == "somebody's own"


def test_what_cannot_be_written_whole_is_not_there(tmp_path: Path) -> None:
    def change(root: ElementTree.Element) -> None:
        urdf.with_meshes_alone(root)
        visual = ElementTree.SubElement(urdf.part(root, "link", "head"), "visual")
        shape = ElementTree.SubElement(visual, "geometry")
        ElementTree.SubElement(shape, "mesh", filename="pictures/head.obj")

    pictures = tmp_path / "drawn" / "pictures"
    pictures.mkdir(parents=True)
    (pictures / "head.obj").write_text(urdf.CUBE)
    own = tmp_path / "made" / "made_meshes" / "pictures"
    own.parent.mkdir(parents=True)
    own.write_text("a file of somebody's")
    with pytest.raises(FileExistsError):
        made(tmp_path, change, FEET)
    left = [path.name for path in (tmp_path / "made").rglob("*")]
    assert left == ["made_meshes", "pictures"]
    assert own.read_text() == "a file of somebody's"


@pytest.mark.parametrize(("rate_hz", "hold_s"), [(50.0, 0.08), (1000.0, 0.02)])
def test_a_slow_loop_may_miss_a_tick_before_it_is_held(
    rate_hz: float, hold_s: float, tmp_path: Path
) -> None:
    robot = made(tmp_path, urdf.nothing, replace(FEET, rate_hz=rate_hz)).robot
    assert robot.file.gate.hold_after_s == hold_s


def test_a_name_may_end_no_comment(tmp_path: Path) -> None:
    robot = made(tmp_path, urdf.nothing, replace(FEET, name="a--b"))
    assert robot.robot.file.name == "a--b"
