"""DCM reference over the phases of a walk, in closed form, computed backwards.

With w = sqrt(g / z_com) the divergent component of motion (DCM) xi = c + c'/w obeys xi'
= w (xi - p), where p is the zero-moment point (ZMP). In a phase of duration T the
desired p is linear, from a to b: p(s) = a + r s with r = (b - a) / T. Then

    xi(s) = p(s) + r / w + exp(w (s - T)) (xi(T) - b - r / w)

is the one solution that ends in xi(T). Errors at the end shrink towards the beginning,
so a preview of a few steps determines the present DCM (Englsberger et al. 2015,
"Three-dimensional bipedal walking control based on divergent component of motion").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

Point = tuple[float, float]
"""x and y, odometry frame [m]."""
SHORTEST_S = 1e-6
"""Duration below which a phase is over."""


class ZmpPhase(NamedTuple):
    """A desired ZMP that moves at constant velocity.

    Attributes:
        duration_s: duration of the phase [s].
        begin: ZMP at the beginning [m].
        end: ZMP at the end [m].
    """

    duration_s: float
    begin: Point
    end: Point


def dcm_at_begin(phase: ZmpPhase, xi_end: Point, omega: float) -> Point:
    """Return the DCM at the beginning of a phase, (x, y) [m].

    Args:
        phase: the desired ZMP.
        xi_end: DCM at its end [m].
        omega: of the pendulum [1/s].
    """
    T = phase.duration_s
    if T < SHORTEST_S:
        return xi_end
    decay = math.exp(-omega * T)
    (a_x, a_y), (b_x, b_y) = phase.begin, phase.end
    ahead_x, ahead_y = (b_x - a_x) / (omega * T), (b_y - a_y) / (omega * T)
    return (
        a_x + ahead_x + decay * (xi_end[0] - b_x - ahead_x),
        a_y + ahead_y + decay * (xi_end[1] - b_y - ahead_y),
    )


def dcm_now(phases: Sequence[ZmpPhase], xi_end: Point, omega: float) -> Point:
    """Return the present DCM that leads to a given end, (x, y) [m].

    Args:
        phases: the phases from now on.
        xi_end: DCM at the end of the last one [m].
        omega: of the pendulum [1/s].
    """
    xi = xi_end
    for phase in reversed(phases):
        xi = dcm_at_begin(phase, xi, omega)
    return xi


def shift_between(
    xi_begin: Point,
    zmp_begin: Point,
    zmp_end: Point,
    xi_end: Point,
    *,
    duration_s: float,
    omega: float,
) -> Point:
    """Return the ZMP at half time that leads the DCM from one point to another.

    The ZMP first moves away from the foot that it is to reach, which accelerates the
    centre of mass. It is linear in both halves of the shift. The DCM at the beginning
    depends linearly on the point between the halves.

    Args:
        xi_begin: DCM at the beginning [m].
        zmp_begin: ZMP there [m].
        zmp_end: ZMP at the end [m].
        xi_end: DCM there [m].
        duration_s: of the shift.
        omega: of the pendulum [1/s].
    """
    half = 0.5 * duration_s

    def begin_with(halfway: Point) -> Point:
        halves = (ZmpPhase(half, zmp_begin, halfway), ZmpPhase(half, halfway, zmp_end))
        return dcm_now(halves, xi_end, omega)

    at_zero, at_one = begin_with((0.0, 0.0)), begin_with((1.0, 1.0))
    return (
        (xi_begin[0] - at_zero[0]) / (at_one[0] - at_zero[0]),
        (xi_begin[1] - at_zero[1]) / (at_one[1] - at_zero[1]),
    )


def end_of_support(
    support: Point,
    following: Point,
    *,
    single_s: float,
    double_s: float,
    omega: float,
) -> Point:
    """Return about where the DCM is when single support begins, in mid-walk.

    Used as the end of a preview: all that follows counts as more steps of this kind.

    Args:
        support: ZMP on the foot that will stand alone [m].
        following: ZMP on the next foot [m].
        single_s: duration of single support [s].
        double_s: duration of the double support after it [s].
        omega: of the pendulum [1/s].
    """
    share = math.exp(-omega * (single_s + 0.5 * double_s))
    return (
        support[0] + share * (following[0] - support[0]),
        support[1] + share * (following[1] - support[1]),
    )
