"""COMTEST's figures in EUROBENCH's files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from surefoot.bench.frequency_response import FrequencyResponse, numbers
from surefoot.bench.names import plain
from surefoot.bench.sway_results import SwayResult
from surefoot.bench.yaml_files import write_scalar, write_vector

_STEP = {
    "sway_peak": "largest sway over the step of the ground [deg/deg]",
    "sway_peak_s": "peak time [s]",
    "sway_final": "sway that stays over the step of the ground [deg/deg]",
    "settling_s": "settling time to 2 % [s]",
    "delay_s": "delay time, to half of the answer [s]",
    "rise_s": "rise time, to 90 % of the answer [s]",
    "overshoot": "overshoot of the answer [1]",
}
_SINE = {
    "gain": "gain [deg/deg]",
    "phase_deg": "phase [deg]",
    "power_ratio": "share of the power at the frequency of the stimulus [1]",
}


def write_sway_yaml(folder: Path, results: Iterable[SwayResult]) -> None:
    """Write a folder for each controller and run, one file a figure.

    Args:
        folder: made if need be; files of the same runs are replaced.
        results: of the runs.
    """
    for result in results:
        place = folder / plain(result.under.label) / plain(result.stimulus.case)
        write_scalar(place / "fall.yaml", float(not result.is_up), label="fell [1]")
        if result.response is not None:
            _write_response(place, result.response, result.score)
        names = _STEP if result.stimulus.protocol == "transient" else _SINE
        for name, label in names.items():
            if result.stimulus.protocol != "prts" and result.seen:
                write_scalar(place / f"{name}.yaml", result.seen[name], label=label)


def _write_response(
    place: Path, response: FrequencyResponse, score: float | None
) -> None:
    labels = [f"{f:g} Hz" for f in response.frequencies_hz]
    columns: dict[str, Any] = {
        "gain": response.gain,
        "phase_deg": response.phase_deg,
        "coherence": response.coherence,
        "frf_real": response.response.real,
        "frf_imaginary": response.response.imag,
    }
    for name, values in columns.items():
        write_vector(place / f"{name}.yaml", numbers(values), labels=labels)
    if score is not None:
        write_scalar(place / "score.yaml", score, label="D, distance from people [1]")
