"""Finds settings that contradict each other, the robot or the run."""

from __future__ import annotations

import numpy as np

from surefoot.robot_io.robot import Robot
from surefoot.schemas.errors import FileFormatError
from surefoot.schemas.settings import (
    ControllerSettings,
    DikSettings,
    EstimatorSettings,
)
from surefoot.stabilizer.model import GRAVITY, RobotModel


def check_settings(
    settings: ControllerSettings, robot: Robot, *, duration_s: float | None = None
) -> None:
    """Refuse settings that no robot, this robot or this run can be controlled with.

    What one section shows by itself was refused when it was read.

    Args:
        settings: resolved.
        robot: to be controlled.
        duration_s: of the run; None when it is not known [s].

    Raises:
        FileFormatError: two settings, or a setting and the robot or the run,
            contradict each other; the message names both.
    """
    _check_forces(settings, weight=RobotModel(robot).mass * GRAVITY)
    _check_margin(settings.dik.limit_margin_rad, robot)
    calibration_s = settings.estimator.calibration_s
    # A run shorter than the usual calibration is no mistake of the settings.
    is_asked = calibration_s > EstimatorSettings().calibration_s
    if duration_s is not None and is_asked and calibration_s >= duration_s:
        raise FileFormatError(
            f"estimator.calibration_s: got {calibration_s:g} s for a run of "
            f"{duration_s:g} s, in which the robot would never balance; expected less",
            field="estimator.calibration_s",
        )


def _check_forces(settings: ControllerSettings, *, weight: float) -> None:
    tsid, zmp = settings.tsid, settings.zmp
    largest = tsid.normal_force_max_weights * weight
    if tsid.normal_force_min_n >= largest:
        raise FileFormatError(
            f"tsid.normal_force_min_n: got {tsid.normal_force_min_n:g} N, expected "
            f"less than the largest, {tsid.normal_force_max_weights:g} "
            f"(tsid.normal_force_max_weights) x {weight:.0f} N of weight",
            field="tsid.normal_force_min_n",
        )
    for name, force in (
        ("tsid.normal_force_min_n", tsid.normal_force_min_n),
        ("zmp.min_ds_pressure_n", zmp.min_ds_pressure_n),
    ):
        if 2.0 * force >= weight:
            raise FileFormatError(
                f"{name}: got {force:g} N for each foot, expected less than half the "
                f"robot's weight, {0.5 * weight:.0f} N",
                field=name,
            )
    if zmp.touchdown_force_n <= settings.contact.regained_above_n:
        raise FileFormatError(
            f"zmp.touchdown_force_n: got {zmp.touchdown_force_n:g} N, expected more "
            f"than contact.regained_above_n, {settings.contact.regained_above_n:g} N; "
            "a lifted foot would stop short of the ground",
            field="zmp.touchdown_force_n",
        )


def _check_margin(margin: float, robot: Robot) -> None:
    """Narrow and locked joints, which the usual margin would fill, are no matter."""
    half = 0.5 * (robot.soft_upper - robot.soft_lower)
    half[half <= DikSettings().limit_margin_rad] = np.inf
    index = int(np.argmin(half))
    if margin >= half[index]:
        raise FileFormatError(
            f"dik.limit_margin_rad: got {margin:g} rad, expected less than half the "
            f"range of every joint; that of {robot.joint_names[index]} is "
            f"{half[index]:.3f} rad",
            field="dik.limit_margin_rad",
        )
