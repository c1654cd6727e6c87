"""DYSTURBANCE's figures in EUROBENCH's files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from surefoot.bench.names import plain
from surefoot.bench.push_results import PushResult, impedances
from surefoot.bench.yaml_files import write_scalar, write_vector


def write_push_yaml(folder: Path, results: Sequence[PushResult]) -> None:
    """Write a folder for each controller and push, one file a figure.

    Args:
        folder: made if need be; files of the same pushes are replaced.
        results: of all pushes.
    """
    for result in results:
        unit = result.unit
        place = folder / plain(result.under.label) / plain(result.disturbance.words)
        write_vector(
            place / "stability_margin.yaml",
            [result.margin, result.normalised],
            labels=[
                f"stability margin [{unit}]",
                f"normalised stability margin [{unit}]",
            ],
        )
        write_vector(
            place / "absorbed_energy.yaml",
            [result.energy_j, result.normalised_energy_j],
            labels=["absorbed energy [J]", "normalised absorbed energy [J]"],
        )
        if result.absorbed is not None:
            label = "absorbed share of the energy [1]"
            write_scalar(place / "absorbed_share.yaml", result.absorbed, label=label)
    for found in impedances(results):
        if found.impedance is not None:
            words = f"{found.kind} {found.direction_deg:g} deg"
            place = folder / plain(found.under.label) / plain(words)
            write_vector(
                place / "equivalent_impedance.yaml",
                found.impedance,
                labels=["inertia [kg]", "damping [N s/m]", "stiffness [N/m]"],
            )
