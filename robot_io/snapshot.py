"""One consistent reading of all sensors of one tick."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.arrays import Array, Vec3, Vec6


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Sensors of one tick, as the robot reports them; arrays are not to be written.

    Attributes:
        tick: the robot's counter.
        stamp_ns: the robot's monotonic clock [ns].
        q: (n_a,) measured joint positions [rad].
        dq: (n_a,) measured joint velocities [rad/s].
        effort: (n_a,) servo torques [N m].
        quat_xyzw: (4,) attitude the unit itself reports, world from IMU.
        angular_velocity: (3,) gyroscope, IMU frame [rad/s].
        linear_acceleration: (3,) specific force, IMU frame [m/s^2].
        ft_left: (6,) [force; moment] from below on the left ankle, sensor frame.
        ft_right: (6,) the same for the right ankle.
    """

    tick: int
    stamp_ns: int
    q: Array
    dq: Array
    effort: Array
    quat_xyzw: Array
    angular_velocity: Vec3
    linear_acceleration: Vec3
    ft_left: Vec6
    ft_right: Vec6
