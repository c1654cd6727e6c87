"""Physical and numerical constants of the simulation."""

from __future__ import annotations

SIM_STEP_S = 0.001
"""Simulation step [s]; a control period is a whole multiple of it."""
GRAVITY_M_S2 = 9.81
BLEND_S = 0.020
"""Ramps and drops start and stop over this time [s]."""
