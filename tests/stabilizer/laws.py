"""Wrench laws with settings of the test's choosing."""

from __future__ import annotations

from typing import Any

import msgspec

from surefoot.schemas.settings import ControllerSettings
from surefoot.stabilizer.control.force_feedback import ForceFeedback

PERIOD_S = 0.001
NO_GAIN = (0.0,) * 6
HALF_SIZES = ((0.1357, 0.0774), (0.1357, 0.0774))
"""Of the Walker's soles [m]."""


def settings_with(**sections: dict[str, Any]) -> ControllerSettings:
    """Defaults with some values replaced."""
    settings = ControllerSettings()
    for name, values in sections.items():
        section = msgspec.structs.replace(getattr(settings, name), **values)
        settings = msgspec.structs.replace(settings, **{name: section})
    return settings


def make_law(settings: ControllerSettings, *, lag_s: float = 0.0) -> ForceFeedback:
    return ForceFeedback(
        settings.dik,
        settings.ground,
        settings.contact,
        half_sizes=HALF_SIZES,
        sole_scale=settings.tsid.sole_scale,
        period_s=PERIOD_S,
        lag_s=lag_s,
    )


PAPER = settings_with(
    ground={"gain": NO_GAIN}, dik={"stance_leak": 0.0, "keep_flat": 0.0}
)
"""Nothing beside the paper's own law."""
