"""The score against people: known values of the published data."""

from __future__ import annotations

import numpy as np
import pytest

from surefoot.bench.sway_cells import CYCLE_S
from surefoot.bench.sway_response import GROUPS, human_sway

CHECK_TOLERANCE = 1e-5
UPRIGHT_IN_SPACE, RIGID_WITH_PLATFORM = 4.061311, 2.884273


@pytest.mark.parametrize(
    ("response", "score"), [(0.0, UPRIGHT_IN_SPACE), (1.0, RIGID_WITH_PLATFORM)]
)
def test_score_has_the_published_values(response: float, score: float) -> None:
    everywhere = np.full(11, response, dtype=np.complex128)
    assert human_sway().score(everywhere) == pytest.approx(score, abs=CHECK_TOLERANCE)


def test_the_mean_person_has_no_distance_and_any_other_has_one() -> None:
    human = human_sway()
    mean = human.mean[:11] + 1j * human.mean[11:]
    assert human.score(mean) == pytest.approx(0.0, abs=CHECK_TOLERANCE)
    for index in range(11):
        other = mean.copy()
        other[index] *= 1.5j
        assert human.score(other) > CHECK_TOLERANCE


def test_frequencies_of_the_people_are_those_of_the_analysis() -> None:
    ours = [np.mean(group) / CYCLE_S for group in GROUPS]
    assert human_sway().frequencies_hz == pytest.approx(ours)


def test_percentiles_are_in_order() -> None:
    human = human_sway()
    gains = [human.gain_percentiles[p] for p in (5, 25, 50, 75, 95)]
    assert (np.diff(gains, axis=0) > 0.0).all()
    scores = [human.score_percentiles[p] for p in (0, 5, 25, 50, 75, 95, 100)]
    assert (np.diff(scores) > 0.0).all()
