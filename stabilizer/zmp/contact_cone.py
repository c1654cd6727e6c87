"""Wrenches a flat foot can hold: the contact-wrench cone of a rectangular sole."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Mat


def contact_cone(*, friction: float, half_length: float, half_width: float) -> Mat:
    """(16, 6) rows C with C F <= 0, F = [force; moment] in the sole frame.

    Friction pyramid, centre of pressure inside the rectangle, and the yaw moment
    that friction over the whole rectangle can hold besides the other components.

    Args:
        friction: coefficient mu.
        half_length: of the sole along x [m].
        half_width: of the sole along y [m].
    """
    mu, x, y = friction, half_length, half_width
    yaw = mu * (x + y)
    rows = [
        #  f_x   f_y   f_z  m_x   m_y   m_z
        [1.0, 0.0, -mu, 0.0, 0.0, 0.0],
        [-1.0, 0.0, -mu, 0.0, 0.0, 0.0],
        [0.0, 1.0, -mu, 0.0, 0.0, 0.0],
        [0.0, -1.0, -mu, 0.0, 0.0, 0.0],
        [0.0, 0.0, -y, 1.0, 0.0, 0.0],
        [0.0, 0.0, -y, -1.0, 0.0, 0.0],
        [0.0, 0.0, -x, 0.0, 1.0, 0.0],
        [0.0, 0.0, -x, 0.0, -1.0, 0.0],
    ]
    # -yaw f_z + |y f_x - mu m_x| + |x f_y - mu m_y| <= m_z, and its mirror image.
    for a in (1.0, -1.0):
        for b in (1.0, -1.0):
            rows.append([a * y, b * x, -yaw, -a * mu, -b * mu, -1.0])
            rows.append([a * y, b * x, -yaw, a * mu, b * mu, 1.0])
    return np.array(rows)
