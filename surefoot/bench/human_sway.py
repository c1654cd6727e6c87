"""How standing people sway on a tilting platform, and how far a response is from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from surefoot.bench.frequency_response import Complex
from surefoot.schemas.arrays import Array

DATA = Path(__file__).parent / "human_sway.json"


@dataclass(frozen=True)
class HumanSway:
    """Statistics over people; the data file names where they come from.

    Attributes:
        frequencies_hz: (11,) of the response at the platform's ordinary pace [Hz].
        gain_percentiles: (11,) each, by percentile: lean over tilt [deg/deg].
        mean: (22,) mean response: real parts, then imaginary parts.
        weight: (22, 22) symmetric, of the squared distance from the mean.
        score_percentiles: score of the people themselves, by percentile.
        sources: where all this comes from.
    """

    frequencies_hz: Array
    gain_percentiles: dict[int, Array]
    mean: Array
    weight: Array
    score_percentiles: dict[int, float]
    sources: tuple[str, ...]

    def score(self, response: Complex) -> float:
        """Return D, the distance of a response from people's.

        Implements the score of arXiv 2110.14395: D^2 = d' W inv(C) W d, d the distance
        from the mean. Half of all people are below 1.6.

        Args:
            response: (11,) complex, lean over tilt at the eleven frequencies.
        """
        d = np.concatenate([response.real, response.imag]) - self.mean
        return float(np.sqrt(d @ self.weight @ d))


@cache
def human_sway() -> HumanSway:
    """Return the statistics that come with this package."""
    table: dict[str, Any] = msgspec.json.decode(DATA.read_bytes())
    weights = np.tile(np.array(table["score_weights"]), 2)
    return HumanSway(
        frequencies_hz=np.array(table["frequencies_hz"]),
        gain_percentiles={
            int(p): np.array(gains) for p, gains in table["gain_percentiles"].items()
        },
        mean=np.array(table["mean_real"] + table["mean_imag"]),
        weight=weights[:, None] * np.linalg.inv(table["covariance"]) * weights,
        score_percentiles={int(p): v for p, v in table["score_percentiles"].items()},
        sources=tuple(table["sources"]),
    )
