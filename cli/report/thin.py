"""Fewer points that draw the same curve."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from schemas.arrays import Array

BUCKETS = 800
"""Stretches of time per curve, about one per pixel of a wide plot."""


def thin(times: Array, values: Array, *, buckets: int = BUCKETS) -> tuple[Array, Array]:
    """Keeps the least and the largest value of each stretch of time.

    So a peak of one tick is seen, which every n-th point would miss.

    Args:
        times: (n,) in order.
        values: (n,).
        buckets: stretches of as many points each.

    Returns:
        Times and values, at most 2 per stretch, in order; first and last are kept.
    """
    count = len(times)
    if count <= 2 * buckets:
        return times, values
    edges = np.linspace(0, count, buckets + 1).astype(int)
    kept = {0, count - 1}
    for start, end in pairwise(edges):
        stretch = values[start:end]
        kept.add(start + int(np.argmin(stretch)))
        kept.add(start + int(np.argmax(stretch)))
    rows = np.array(sorted(kept))
    return times[rows], values[rows]


def changes(times: Array, values: Array) -> tuple[Array, Array]:
    """Keeps where a value that stays the same for long becomes another one.

    Args:
        times: (n,) in order.
        values: (n,).

    Returns:
        Times and values of first, changes and last.
    """
    if len(times) == 0:
        return times, values
    is_new = np.concatenate(([True], values[1:] != values[:-1]))
    is_new[-1] = True
    return times[is_new], values[is_new]
