"""Shipped scenarios, cut short for studies of many runs."""

from __future__ import annotations

import re

from surefoot.sim_robot.catalogue import find_scenario


def shortened(name: str, duration_s: float) -> str:
    """Return the text of a shipped scenario with another duration.

    Args:
        name: of the scenario.
        duration_s: how long it is to last [s].
    """
    text = find_scenario(name).read_text(encoding="utf-8")
    whole = f"duration_s = {duration_s}"  # the first: pushes have theirs behind it
    return re.sub(r"(?m)^duration_s = .*$", whole, text, count=1)
