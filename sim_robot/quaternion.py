"""The one place where MuJoCo's quaternions change their order."""

from __future__ import annotations

import numpy as np

from surefoot.schemas.arrays import Array

_FROM_WXYZ = np.array([1, 2, 3, 0])
_FROM_XYZW = np.array([3, 0, 1, 2])


def xyzw(quat_wxyz: Array) -> Array:
    """Put the scalar last.

    Args:
        quat_wxyz: (4,) as MuJoCo has it.

    Returns:
        (4,) as the bus and the controller have it; a new array.
    """
    return quat_wxyz.take(_FROM_WXYZ)


def wxyz(quat_xyzw: Array) -> Array:
    """Put the scalar first, (4,) to (4,); the inverse of :func:`xyzw`."""
    return quat_xyzw.take(_FROM_XYZW)
