"""Array aliases and unit factors shared by all packages."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Any float64 array; each use states its shape."""
Vec3 = NDArray[np.float64]
"""(3,) vector."""
Vec6 = NDArray[np.float64]
"""(6,) wrench [force; moment] or twist [linear; angular]."""
Mat = NDArray[np.float64]
"""(m, n) matrix."""

Floats = list[float]
"""Numbers on the wire: one per joint, in the order of the robot file."""
Floats3 = Annotated[list[float], msgspec.Meta(min_length=3, max_length=3)]
Floats4 = Annotated[list[float], msgspec.Meta(min_length=4, max_length=4)]
Floats6 = Annotated[list[float], msgspec.Meta(min_length=6, max_length=6)]
Pair = Annotated[list[float], msgspec.Meta(min_length=2, max_length=2)]
"""(left, right)."""
JsonObject = dict[str, Any]
MS_PER_S, NS_PER_S, MM_PER_M = 1e3, 1e9, 1e3
NS_PER_MS, MS_PER_NS = 1e6, 1e-6
GRAVITY_M_S2 = 9.81
"""Gravity of a simulated world when the scenario gives none."""
