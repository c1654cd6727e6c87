"""Distribution QP of the ZMP baseline: both feet's wrenches from a net wrench.

In words: find the sole wrenches F = (F_left, F_right) that

    minimise    1e4 |X_l F_l + X_r F_r - w*|^2          net wrench
              + 100 (|D A_l F_l|^2 + |D A_r F_r|^2)     ankle torques
              + 1   ((1 - r) Fz_l - r Fz_r)^2           load share
    subject to  each F_i in its contact-wrench cone, Fz_i >= 15 N.

X maps a sole wrench to world axes about the centre of mass, A shifts it to the ankle.
The unknowns are in the sole frames, where the cones are constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surefoot.schemas.arrays import Array, Mat, Vec3
from surefoot.schemas.law_settings import ZmpSettings
from surefoot.stabilizer.control.tsid import sole_rows
from surefoot.stabilizer.dynamics import NORMAL, cross
from surefoot.stabilizer.model import RobotModel, skew
from surefoot.stabilizer.qp import DenseQp, QpSolution

ANKLE_SCALE = np.array([1e-3, 1e-3, 1e-4, 1.0, 1.0, 1e-4])
"""D: scale of force [1/N] and moment [1/(N m)] residuals at the ankle."""
CONE_ROWS = 16
ROWS_PER_FOOT = CONE_ROWS + 1
LEAST_FOOT_FORCE_N = 1.0
"""Normal force below which a foot does not count [N]."""
LEAST_NET_FORCE_N = 1.0
"""Normal force below which there is no zero-moment point [N]."""


def wrench_face_matrix(
    *, friction: float, half_length: float, half_width: float
) -> Mat:
    """Return (16, 6) rows C with C F <= 0, F = [force; moment] in the sole frame.

    The rows are a friction pyramid, the centre of pressure inside the rectangle, and
    the yaw moment that friction over the whole rectangle can hold with the other
    components.

    Args:
        friction: coefficient mu.
        half_length: of the sole along x [m].
        half_width: of the sole along y [m].
    """
    mu, x, y = friction, half_length, half_width
    yaw = mu * (x + y)
    rows: list[list[float]] = []
    # -yaw f_z + |y f_x - mu m_x| + |x f_y - mu m_y| <= m_z, and its mirror image.
    for a in (1.0, -1.0):
        for b in (1.0, -1.0):
            rows.append([a * y, b * x, -yaw, -a * mu, -b * mu, -1.0])
            rows.append([a * y, b * x, -yaw, a * mu, b * mu, 1.0])
    return np.vstack((sole_rows(mu, x, y), rows))


class Plane(NamedTuple):
    """Plane of the zero-moment point: origin (3,) [m] and unit normal (3,)."""

    origin: Vec3
    normal: Vec3


def contact_plane(
    R_world_sole: list[Mat], p_sole: list[Vec3], in_contact: list[bool]
) -> Plane:
    """Return the plane between two standing feet, or that of the one standing foot.

    Args:
        R_world_sole: rotations of left and right sole.
        p_sole: (3,) positions in the world [m].
        in_contact: which feet stand.
    """
    if in_contact[0] != in_contact[1]:
        foot = 0 if in_contact[0] else 1
        return Plane(p_sole[foot], R_world_sole[foot][:, 2])
    normal = R_world_sole[0][:, 2] + R_world_sole[1][:, 2]
    normal /= np.linalg.norm(normal)
    return Plane(0.5 * (p_sole[0] + p_sole[1]), normal)


def sole_to_world(R_world_sole: Mat, p_sole: Vec3, point: Vec3) -> Mat:
    """Return (6, 6) map of a sole-frame wrench to world axes, about a point.

    The moment is taken about ``point``, not about the world's origin: far from there,
    rounding and the lever of small force errors would dominate it.

    Args:
        R_world_sole: rotation of the sole.
        p_sole: (3,) its position [m].
        point: (3,) what moments are about [m].
    """
    X = np.zeros((6, 6))
    X[:3, :3] = R_world_sole
    X[3:, 3:] = R_world_sole
    X[3:, :3] = skew(p_sole - point) @ R_world_sole
    return X


def net_wrench(
    F: Array, R_world_sole: list[Mat], p_sole: list[Vec3], point: Vec3
) -> Array:
    """Return (6,) sum of both feet's wrenches, world axes, about a point.

    Args:
        F: (12,) wrenches of the ground on the soles, sole frames.
        R_world_sole: rotations of the soles.
        p_sole: (3,) their positions [m].
        point: (3,) what moments are about [m].
    """
    total = np.zeros(6)
    for side in (0, 1):
        foot = F[6 * side : 6 * side + 6]
        if foot[2] <= LEAST_FOOT_FORCE_N:
            continue
        total += sole_to_world(R_world_sole[side], p_sole[side], point) @ foot
    return total


def zero_moment_point(wrench: Array, plane: Plane, *, otherwise: Vec3) -> Vec3:
    """Return the point of the plane about which the wrench has no tangential moment.

    Args:
        wrench: (6,) world axes, about the plane's origin.
        plane: plane of the point.
        otherwise: (3,) result when there is no force [m].
    """
    force, moment = wrench[:3], wrench[3:]
    normal_force = float(plane.normal @ force)
    if normal_force < LEAST_NET_FORCE_N:
        return otherwise
    point: Vec3 = plane.origin + cross(plane.normal, moment) / normal_force
    return point


class WrenchDistribution:
    """Builds and solves the QP, for both feet or one.

    Attributes:
        F: (12,) desired wrenches, sole frames; zero for a foot that does not stand.
    """

    def __init__(self, model: RobotModel, settings: ZmpSettings) -> None:
        """Allocate a problem for two feet and one for each foot alone."""
        # Costs are relative to the net wrench's, which keeps the numbers small.
        self._ankle = settings.ankle_torque_weight / settings.net_wrench_weight
        self._share = settings.pressure_weight / settings.net_wrench_weight
        self._cones = [
            wrench_face_matrix(
                friction=settings.friction,
                half_length=settings.sole_scale * foot.half_length_m,
                half_width=settings.sole_scale * foot.half_width_m,
            )
            for foot in model.robot.file.foot
        ]
        self._ankle_cost = np.zeros((12, 12))
        for side, sole in enumerate(model.sole_ids):
            rows = slice(6 * side, 6 * side + 6)
            D = ANKLE_SCALE[:, None] * _to_ankle(model.pin_model.frames[sole].placement)
            self._ankle_cost[rows, rows] = D.T @ D
        least = settings.min_ds_pressure_n
        self.both = DenseQp("distribution", n=12, m=2 * ROWS_PER_FOOT)
        self.alone = [
            DenseQp(f"distribution {side}", n=6, m=ROWS_PER_FOOT)
            for side in ("left", "right")
        ]
        for side, cone in enumerate(self._cones):
            _limit(self.both, side, cone, least)
            _limit(self.alone[side], 0, cone, least)
        self._X = np.zeros((6, 12))
        self.F: Array = np.zeros(12)

    def solve(
        self,
        wrench: Array,
        *,
        R_world_sole: list[Mat],
        p_sole: list[Vec3],
        point: Vec3,
        in_contact: list[bool],
        left_share: float = 0.5,
    ) -> QpSolution | None:
        """Distribute a net wrench.

        Args:
            wrench: (6,) desired net wrench, world axes, moment about ``point``.
            R_world_sole: rotations of the soles.
            p_sole: (3,) their positions [m].
            point: (3,) what moments are about: the centre of mass [m].
            in_contact: which feet stand.
            left_share: part of the load that the left foot should carry [1].

        Returns:
            The QP's solution, None when no foot stands; ``F`` keeps its last value
            when it failed.
        """
        feet = [side for side in (0, 1) if in_contact[side]]
        if not feet:
            self.F[:] = 0.0
            return None
        for side in feet:
            self._X[:, 6 * side : 6 * side + 6] = sole_to_world(
                R_world_sole[side], p_sole[side], point
            )
        if len(feet) == 2:
            qp, X, rows = self.both, self._X, slice(0, 12)
            X.T.dot(X, out=qp.P)
            qp.P += self._ankle * self._ankle_cost
            left, right = 1.0 - left_share, -left_share
            qp.P[NORMAL, NORMAL] += self._share * left * left
            qp.P[6 + NORMAL, 6 + NORMAL] += self._share * right * right
            qp.P[NORMAL, 6 + NORMAL] += self._share * left * right
            qp.P[6 + NORMAL, NORMAL] += self._share * left * right
        else:
            side = feet[0]
            rows = slice(6 * side, 6 * side + 6)
            qp, X = self.alone[side], self._X[:, rows]
            qp.P[:] = X.T @ X
        qp.q_lin[:] = -(wrench @ X)
        solution = qp.solve()
        if solution.ok:
            self.F[:] = 0.0
            self.F[rows] = solution.x
        return solution


def centre_of_pressure(F: Array) -> tuple[float, float]:
    """Return one foot's centre of pressure, sole frame [m]; middle without force."""
    normal = F.item(NORMAL)
    if normal <= 0.0:
        return 0.0, 0.0
    return -F.item(4) / normal, F.item(3) / normal


def _to_ankle(T_ankle_sole: object) -> Mat:
    """Return (6, 6) shift of a sole wrench to the ankle joint's centre, sole axes."""
    p_ankle: Vec3 = T_ankle_sole.inverse().translation  # type: ignore[attr-defined]
    shift = np.eye(6)
    shift[3:, :3] = -skew(p_ankle)
    return shift


def _limit(qp: DenseQp, block: int, cone: Mat, least: float) -> None:
    """Write one foot's cone and least normal force into a QP."""
    start, columns = ROWS_PER_FOOT * block, slice(6 * block, 6 * block + 6)
    qp.G[start : start + CONE_ROWS, columns] = cone
    qp.h_u[start : start + CONE_ROWS] = 0.0
    qp.G[start + CONE_ROWS, 6 * block + NORMAL] = -1.0
    qp.h_u[start + CONE_ROWS] = -least
