"""Where a motion can be cut so that it repeats without a jerk."""

from __future__ import annotations

import numpy as np

from schemas.arrays import Array

STEP_S = 0.02
"""Moments are compared in such steps."""


def best_loop(
    poses: Array, *, period_s: float, length_s: tuple[float, float]
) -> tuple[int, int]:
    """The stretch that ends most like it began, in pose and in speed.

    Args:
        poses: (n, m) numbers that are alike when the pictures are.
        period_s: from one row to the next [s].
        length_s: shortest and longest stretch [s].

    Returns:
        First and last row; the whole motion if it is shorter than a stretch.
    """
    step = max(1, round(STEP_S / period_s))
    coarse = poses[::step]
    shortest, longest = (round(length / (step * period_s)) for length in length_s)
    if len(coarse) <= shortest + 1:
        return 0, len(poses) - 1
    # Speed counts as the pose a tenth of a second later would.
    speed = np.gradient(coarse, axis=0) * (0.1 / STEP_S)
    seen = np.hstack((coarse, speed))
    best, found = np.inf, (0, shortest)
    for length in range(shortest, min(longest, len(coarse) - 1) + 1):
        apart = np.sum((seen[length:] - seen[:-length]) ** 2, axis=1)
        start = int(np.argmin(apart))
        # A robot at rest is always alike: among equals, the one that moves most.
        moved = np.ptp(coarse[start : start + length], axis=0).sum()
        score = float(apart[start]) / (moved + 1e-9) ** 2
        if score < best:
            best, found = score, (start, start + length)
    return found[0] * step, found[1] * step
