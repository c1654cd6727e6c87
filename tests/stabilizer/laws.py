"""Wrench laws with given settings."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from surefoot.schemas.arrays import Array
from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.force_feedback import ForceFeedback
from surefoot.stabilizer.model import GRAVITY
from tests.stabilizer.rig import BOTH, Rig

PERIOD_S = 0.001
NO_GAIN = (0.0,) * 6
NOTHING = np.zeros(12)
HALF_SIZES = ((0.1357, 0.0774), (0.1357, 0.0774))
"""Half lengths and half widths of the Walker's soles [m]."""


def settings_with(**sections: dict[str, Any]) -> ControllerSettings:
    """Return the default settings with some values replaced."""
    settings = ControllerSettings()
    for name, values in sections.items():
        section = msgspec.structs.replace(getattr(settings, name), **values)
        settings = msgspec.structs.replace(settings, **{name: section})
    return settings


WEIGHT = 70.0 * GRAVITY
"""Weight of the Walker [N]."""


def make_law(
    settings: ControllerSettings,
    *,
    lag_s: float = 0.0,
    speed: float = 0.0,
    weight: float = WEIGHT,
) -> ForceFeedback:
    return ForceFeedback(
        settings.dik,
        settings.ground,
        settings.contact,
        half_sizes=HALF_SIZES,
        sole_scale=settings.tsid.sole_scale,
        period_s=PERIOD_S,
        lag_s=lag_s,
        speed=speed,
        weight=weight,
    )


def answer(
    law: ForceFeedback,
    rig: Rig,
    F_meas: Array,
    *,
    F_id: Array = NOTHING,
    in_contact: list[bool] = BOTH,
) -> Array:
    """Return (12,) the law's sole twists at the rig's state; the law's own array."""
    return law.update(
        rig.dynamics, rig.stance, F_meas=F_meas, F_id=F_id, in_contact=in_contact
    )


PAPER = settings_with(
    ground={"gain": NO_GAIN}, dik={"stance_leak": 0.0, "keep_flat": 0.0}
)
"""The paper's own law without our additions."""
