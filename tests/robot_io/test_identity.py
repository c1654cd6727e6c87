"""The digest of a robot's description tells in which parts two robots differ."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import msgspec
import pytest

from surefoot.robot_io.identity import (
    PARTS,
    UNKNOWN,
    RobotIdentity,
    describe,
    differing,
    new_identity,
    parse_token,
)
from surefoot.robot_io.robot import Robot, load_robot
from tests.command import run_python
from tests.robot_io.strange_robots import MIRRORED, WALKER, changed, remade

DESCRIBE = (
    "from surefoot.robot_io.identity import describe\n"
    "from surefoot.robot_io.robot import load_robot\n"
    "print(describe(load_robot('walker')))"
)


def parts_of(robot: Robot) -> list[str]:
    """Return the parts in which a robot differs from the Walker."""
    return differing(describe(WALKER), describe(robot))


def first_joint(**changes: float) -> Robot:
    first, *others = WALKER.file.joint
    return changed(joint=[msgspec.structs.replace(first, **changes), *others])


def with_urdf(folder: Path, text: str) -> Robot:
    path = folder / "walker.urdf"
    path.write_text(text)
    return remade(WALKER.file, path)


def urdf_text() -> str:
    return WALKER.urdf_path.read_text()


def test_the_digest_fits_a_chunk_of_a_key_and_has_a_hash_for_each_part() -> None:
    hashes = describe(WALKER).split("-")
    assert len(hashes) == len(PARTS)
    assert all(re.fullmatch("[0-9a-f]{8}", one) for one in hashes)


def test_each_process_gets_the_same_digest(tmp_path: Path) -> None:
    for seed in ("1", "2"):
        words = ("-c", DESCRIBE)
        told = run_python(*words, cwd=tmp_path, PYTHONHASHSEED=seed, LC_ALL="C")
        assert told.stdout.strip() == describe(WALKER)


@pytest.mark.parametrize(
    ("robot", "parts"),
    [
        (load_robot("walker"), []),
        (MIRRORED, ["joints", "feet"]),
        (load_robot("walker", servo_profile="harmonic"), ["servo"]),
        (load_robot("walker-real"), ["keys"]),
        (changed(rate_hz=500.0), ["rate"]),
        (changed(imu=msgspec.structs.replace(WALKER.file.imu, frame="torso")), ["imu"]),
        (changed(nominal_base_height_m=1.0), ["posture"]),
        (first_joint(nominal_rad=0.1), ["posture"]),
        (first_joint(velocity_limit_rad_s=1.7), ["limits"]),
        (first_joint(armature_kg_m2=0.03), ["servo"]),
        (first_joint(soft_lower_rad=-0.1), []),
        (changed(name="another word", com_travel_m=(-0.01, 0.01)), []),
        (
            changed(gate=msgspec.structs.replace(WALKER.file.gate, lease_s=9.0)),
            [],
        ),
    ],
)
def test_what_differs_is_named(robot: Robot, parts: list[str]) -> None:
    assert parts_of(robot) == parts


@pytest.mark.parametrize(
    ("pattern", "instead", "parts"),
    [
        (r"<!--.*?-->", "", []),
        (r"<visual>.*?</visual>", "", []),
        (r'mass value="19.8612"', 'mass value="19.86120"', []),
        (r'<origin xyz="-0.00125 0 -0.1116"', '<origin xyz="-1.25e-3 -0  -.1116"', []),
        (r'mass value="19.8612"', 'mass value="19.8613"', ["model"]),
        (r'xyz="-0.00125 0 -0.1116"', 'xyz="-0.00125 0 -0.1117"', ["model"]),
        (r'ixy="0" ixz="0.00486976"', 'ixy="1e-6" ixz="0.00486976"', ["model"]),
    ],
)
def test_of_the_urdf_only_the_mechanics_count(
    tmp_path: Path, pattern: str, instead: str, parts: list[str]
) -> None:
    text, count = re.subn(pattern, instead, urdf_text(), flags=re.DOTALL)
    assert count
    assert parts_of(with_urdf(tmp_path, text)) == parts


def test_a_joint_range_of_the_urdf_is_a_limit(tmp_path: Path) -> None:
    found = re.search(r'lower="([-.\d]+)"', urdf_text())
    assert found is not None
    wider = f'lower="{float(found[1]) - 0.01}"'
    text = urdf_text().replace(found[0], wider, 1)
    assert parts_of(with_urdf(tmp_path, text)) == ["limits"]


def test_the_order_of_links_in_the_urdf_does_not_count(tmp_path: Path) -> None:
    root = ElementTree.fromstring(urdf_text())
    root[:] = reversed(root)
    text = ElementTree.tostring(root, encoding="unicode")
    assert parts_of(with_urdf(tmp_path, text)) == []


def test_a_digest_of_another_make_is_no_match() -> None:
    for told in ("", "abc", describe(WALKER) + "-00000000"):
        assert differing(describe(WALKER), told) == [UNKNOWN]


@pytest.mark.parametrize("namespace", ["", "walker/", "lab/alive/robot/walker/"])
def test_a_token_tells_the_identity(namespace: str) -> None:
    identity = new_identity(WALKER)
    assert parse_token(namespace + identity.token) == identity
    assert parse_token(f"{namespace}alive/robot") == RobotIdentity("", "")


def test_every_start_is_another_instance() -> None:
    instances = {new_identity(WALKER).instance for _ in range(100)}
    assert len(instances) == 100
    assert all(re.fullmatch("[0-9a-f]{8}", instance) for instance in instances)
