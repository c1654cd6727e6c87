"""Prepares a URDF for balancing: floating base, driven joints, possible inertias."""

from __future__ import annotations

import math
import re
import shlex
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence

import numpy as np

from surefoot.robot_files.draft import Draft, listed, mass_of
from surefoot.robot_io.errors import RobotFileError
from surefoot.robot_io.urdf_check import drop, end

WORLDS = ("world", "map", "odom", "ground", "universe")
LIGHT_SHARE = 1e-3
"""Joints outside the legs that carry less of the robot's mass are fixed: fingers."""
LEADER_SHARE = 0.02
"""The same share for a joint that other joints follow."""
NO_LIMIT = "1e9"
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_UPPER = np.triu_indices(3)
_ROUNDING = 1e-6
_LEAST_RADIUS_M = 0.01
"""A repaired inertia is at least that of the mass at this radius [m]."""


def drop_world(draft: Draft) -> None:
    """Remove a link that stands for the world, above the robot's own base."""
    base = draft.base
    joints = [j for j in draft.joints.values() if end(j, "parent") == base]
    is_world = base.lower() in WORLDS or any(
        j.get("type") == "floating" for j in joints
    )
    if not is_world or len(joints) != 1:
        return
    draft.root.remove(joints[0])
    draft.root.remove(draft.links[base])
    draft.note("changed", f"link {base!r} above the base is left out: the base floats")


def choose_joints(
    draft: Draft,
    soles: Sequence[str],
    *,
    fix: Sequence[str] = (),
    keep: Sequence[str] = (),
    legs_only: bool = False,
) -> None:
    """Fix all joints that cannot be balanced with, and those that are asked for.

    Args:
        draft: changed in place.
        soles: links of the left and right foot.
        fix: patterns of further joints to fix.
        keep: patterns of joints outside the legs to leave as they are.
        legs_only: fix all joints outside the legs.

    Raises:
        RobotFileError: a leg has a joint without a drive of its own, a pattern fits no
            joint, or a joint to keep has no drive of its own.
    """
    legs = {j.get("name", "") for sole in soles for j in draft.chain(sole)}
    for pattern in (*fix, *keep):
        if not any(_fits(name, pattern) for name in draft.joints):
            raise RobotFileError(
                f"{draft.path}: no joint fits {pattern!r}; the joints are "
                f"{listed([n for n, j in draft.joints.items() if _moves(j)])}"
            )
    leaders = {
        m.get("joint") for m in draft.root.iterfind("joint/mimic") if m is not None
    }
    chains = [{j.get("name", "") for j in draft.chain(sole)} for sole in soles]
    shared = chains[0] & chains[1]
    feet = {name for sole in soles for name in _below_foot(draft, sole)}
    reasons: dict[str, list[str]] = {}
    for name, joint in draft.joints.items():
        if not _moves(joint):
            drop(joint, ("mimic",))
            continue
        why = _reason(draft, name, leaders=leaders, feet=feet, is_leg=name in legs)
        kept = any(_fits(name, pattern) for pattern in keep)
        asked = any(_fits(name, pattern) for pattern in fix)
        if asked or (legs_only and name not in legs):
            why = "as asked"
        elif kept and why not in (None, _FOLLOWS, _ENDLESS):
            why = None
        elif name in keep:  # one that a pattern with * fits is fixed, and told
            if why is not None:
                raise RobotFileError(
                    f"{draft.path}: joint {name!r} cannot be kept: {_of_one(why)}; "
                    "a joint needs limits and its own drive: change the URDF, or leave "
                    f"out --keep {shlex.quote(name)}"
                )
        elif why is None and name in shared and not kept:
            why = _SHARED
        if why is None:
            continue
        if name in legs - shared and not asked:
            raise RobotFileError(
                f"{draft.path}: joint {name!r} of a leg: {_of_one(why)}; a leg's "
                "joints must be revolute, with limits, each with its drive; or fix it: "
                f"--fix {shlex.quote(name)}"
            )
        reasons.setdefault(why, []).append(name)
    for why, names in reasons.items():
        for name in names:
            draft.fix(draft.joints[name])
        count = "a joint" if len(names) == 1 else f"{len(names)} joints"
        draft.note("changed", f"{count} fixed, {why}: {listed(names)}")


def _fits(name: str, pattern: str) -> bool:
    """Whether a name fits a pattern; only ``*`` is special, ``[`` stands for itself."""
    parts = map(re.escape, pattern.split("*"))
    return re.fullmatch(".*".join(parts), name, re.DOTALL) is not None


_FOLLOWS = "they follow another joint (<mimic>)"
_ENDLESS = "they turn without end (continuous)"
_SLIDES = "they slide (prismatic)"
_SHARED = "both legs hang on them: below the base it would only lean"


def _of_one(why: str) -> str:
    """Return a reason in the singular."""
    for verb in ("follow", "turn", "slide"):
        why = why.replace(f"they {verb}", f"it {verb}s")
    return why


def _moves(joint: ElementTree.Element) -> bool:
    return joint.get("type") != "fixed"


def _reason(
    draft: Draft, name: str, *, leaders: set[str | None], feet: set[str], is_leg: bool
) -> str | None:
    """Return why a joint cannot be balanced with; None if it can."""
    joint = draft.joints[name]
    if joint.find("mimic") is not None:
        return _FOLLOWS
    if joint.get("type") == "continuous":
        return _ENDLESS
    if joint.get("type") == "prismatic":
        return _SLIDES
    if name in feet:
        return "below a foot, which is one body here"
    if is_leg:
        return None
    carried, whole = draft.carried_kg(joint), draft.mass_kg
    if name in leaders and carried < LEADER_SHARE * whole:
        return "others follow them, as fingers do"
    if carried < LIGHT_SHARE * whole:
        return f"they carry less than {100.0 * LIGHT_SHARE:g} % of the robot"
    limit = joint.find("limit")
    if limit is not None and limit.get("lower") == limit.get("upper"):
        return "their range is empty"
    return None


def _below_foot(draft: Draft, sole: str) -> list[str]:
    """Return the moving joints below a foot, such as toes."""
    top = foot_links(draft, sole)[0]
    inside = set(draft.below(top))
    return [
        name
        for name, joint in draft.joints.items()
        if end(joint, "parent") in inside and _moves(joint)
    ]


def foot_links(draft: Draft, sole: str) -> list[str]:
    """Return the links that are rigidly one with a sole, the topmost first."""
    top = sole
    for joint in draft.chain(sole):
        if _moves(joint):
            break
        top = end(joint, "parent")
    found = [top]
    for name in found:
        found += [
            end(j, "child")
            for j in draft.joints.values()
            if end(j, "parent") == name and not _moves(j)
        ]
    return found


def open_limits(draft: Draft) -> None:
    """Replace missing or infinite torque and speed limits by ``NO_LIMIT``."""
    for joint in draft.joints.values():
        limit = joint.find("limit")
        if limit is None or not _moves(joint):
            continue
        for key in ("effort", "velocity"):
            try:
                is_limit = 0.0 < float(limit.get(key, "0")) < math.inf
            except ValueError:
                continue  # refused later, with its place
            if not is_limit:
                limit.set(key, NO_LIMIT)


def check_feet(draft: Draft, soles: Sequence[str]) -> None:
    """Refuse soles on the base, and two soles on one leg.

    Raises:
        RobotFileError: a sole is part of the base, or one moves with the other.
    """
    for this, other in (soles, reversed(soles)):
        if foot_links(draft, this)[0] == draft.base:
            raise RobotFileError(
                f"{draft.path}: sole {this!r} is one body with {draft.base!r}, which "
                "all else hangs on; name a link of a foot, in a URDF whose root is the "
                "trunk or the pelvis"
            )
        if other in draft.below(foot_links(draft, this)[0]):
            raise RobotFileError(
                f"{draft.path}: soles {this!r} and {other!r} are on one foot; name one "
                "link of each foot"
            )


def settle_inertias(draft: Draft, *, repair: bool) -> None:
    """Find links whose inertia no body can have, and repair them if asked.

    The second moments of mass, Sigma = tr(I) / 2 E - I, cannot be negative. Negative
    ones are replaced by those of a small body.

    Raises:
        RobotFileError: there are such links, and ``repair`` is false.
    """
    impossible = []
    for name, link in draft.links.items():
        mass, tensor = mass_of(link), link.find("inertial/inertia")
        if tensor is None or mass <= 0.0:
            continue
        I = np.zeros((3, 3))  # noqa: E741
        try:
            I[_UPPER] = [float(tensor.get(key, "")) for key in _INERTIA]
        except ValueError:
            continue  # refused later, with its place
        I = np.triu(I) + np.triu(I, 1).T  # noqa: E741
        if not np.all(np.isfinite(I)):
            continue  # refused later, too
        second = 0.5 * np.trace(I) * np.eye(3) - I
        values, axes = np.linalg.eigh(second)
        if values[0] >= -_ROUNDING * values[2] and np.linalg.eigvalsh(I)[0] > 0.0:
            continue
        impossible.append(name)
        least = mass * _LEAST_RADIUS_M**2 / 3.0
        second = axes @ np.diag(np.maximum(values, least)) @ axes.T
        possible = np.trace(second) * np.eye(3) - second
        for key, value in zip(_INERTIA, possible[_UPPER], strict=True):
            tensor.set(key, f"{value:.9g}")
    if not impossible:
        return
    if not repair:
        raise RobotFileError(
            f"{draft.path}: no body has the inertia of {listed(impossible)}; mend "
            "these links, or have them given the nearest inertia that can be: "
            "--repair-inertias"
        )
    draft.note("changed", f"impossible inertias repaired: {listed(impossible)}")
