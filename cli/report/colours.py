"""Colours that people with any colour vision tell apart (after Okabe and Ito)."""

from __future__ import annotations

BLUE, VERMILION, GREEN = "#0072b2", "#d55e00", "#009e73"
ORANGE, PINK, SKY = "#e69f00", "#cc79a7", "#56b4e9"
RUN_COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PINK, SKY)
"""One per run, in the order they were named; as many as a page takes."""
