"""EUROBENCH's files, read by a YAML library."""

from __future__ import annotations

import math
from pathlib import Path

import yaml

from surefoot.bench.bench_files import write_scalar, write_vector
from surefoot.bench.bench_runs import plain
from surefoot.bench.push_cells import Disturbance

AWKWARD = [1e-7, 0.25, -3.0, 2e22, 0.1 + 0.2]


def test_a_vector_comes_back_with_its_labels(tmp_path: Path) -> None:
    labels = [f"x: {i} [deg/deg]" for i in range(len(AWKWARD))]
    write_vector(tmp_path / "new" / "v.yaml", AWKWARD, labels=labels)
    found = yaml.safe_load((tmp_path / "new" / "v.yaml").read_text())
    assert found == {"type": "vector", "label": labels, "value": AWKWARD}


def test_what_could_not_be_told_is_no_number(tmp_path: Path) -> None:
    write_scalar(tmp_path / "s.yaml", None, label="settling time [s]")
    found = yaml.safe_load((tmp_path / "s.yaml").read_text())
    assert found["type"] == "scalar"
    assert math.isnan(found["value"])


def test_opposite_directions_and_other_alphabets_have_folders_of_their_own() -> None:
    words = [Disturbance("sine-force", turn, 0.5).words for turn in (90.0, -90.0)]
    assert [plain(text) for text in words] == [
        "sine_force_90_deg_0.5_hz",
        "sine_force_minus_90_deg_0.5_hz",
    ]
    assert plain("hold, мягко") == "hold_мягко"
