"""``surefoot bench comtest``: the three protocols of COMTEST, their files and page.

The protocols are those of arXiv 2104.11935 and 2110.14395, ``standing on a moving
surface`` of EUROBENCH.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from surefoot.bench.bench_files import (
    Findings,
    TextTable,
    write_scalar,
    write_vector,
)
from surefoot.bench.bench_runs import (
    bench_runs,
    check_positive,
    check_used,
    everyone,
    known_names,
    plain,
    subject_of,
)
from surefoot.bench.sway_cells import (
    AXES,
    PROTOCOLS,
    Protocol,
    Stimulus,
    SwayAxis,
    sway_cell,
)
from surefoot.bench.sway_response import FrequencyResponse, numbers
from surefoot.bench.sway_results import (
    SwayResult,
    sway_result,
    sway_tables,
    write_sway_page,
)
from surefoot.errors import UsageError
from surefoot.presentation import CountBar, no_bar

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
SIZES_DEG = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
QUICK_SIZES_DEG = (8.0,)
LARGEST_DEG = 45.0
"""Largest stimulus, peak to peak; on steeper ground soles slide [deg]."""
FREQUENCIES_HZ = (0.15, 0.4, 0.9, 1.35, 2.2)
QUICK_FREQUENCIES_HZ = (0.4, 0.9, 2.2)
QUICK_AXES: tuple[SwayAxis, ...] = ("pitch", "x")
LEAST_CYCLES, MOST_CYCLES = 3, 1000


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


class Comtest(Findings[SwayResult]):
    """Results of COMTEST, one per run."""

    NAME = "comtest"

    def tables(self) -> list[TextTable]:
        """Return a table for each protocol."""
        return sway_tables(self.results)

    def _write_yaml(self, folder: Path) -> None:
        for result in self.results:
            place = folder / plain(result.under.label) / plain(result.stimulus.case)
            write_scalar(place / "fall.yaml", float(not result.is_up), label="fell [1]")
            if result.response is not None:
                _write_response(place, result.response, result.score)
            names = _STEP if result.stimulus.protocol == "transient" else _SINE
            for name, label in names.items():
                if result.stimulus.protocol != "prts" and result.seen:
                    write_scalar(place / f"{name}.yaml", result.seen[name], label=label)

    def _write_page(self, folder: Path) -> None:
        write_sway_page(folder, self.results, robot=self.who, subject=self.subject)


def comtest(
    robot: str = "walker",
    *,
    quick: bool = False,
    controllers: Sequence[str] | None = None,
    servo_profiles: Sequence[str] | None = None,
    protocols: Sequence[str] | None = None,
    axes: Sequence[str] | None = None,
    sizes_deg: Sequence[float] | None = None,
    frequencies_hz: Sequence[float] | None = None,
    speed: float = 1.0,
    cycles: int = LEAST_CYCLES,
    settings: Mapping[str, Any] | None = None,
    jobs: int = 0,
    scheduler: str | None = None,
    out: str | Path | None = None,
    bar: CountBar = no_bar,
) -> Comtest:
    """Measure how a robot stands on moving ground, with COMTEST's three protocols.

    The ground moves in steps, sines, and a ternary sequence whose frequency response is
    compared with that of people: about pitch and roll, and along x and y.

    Args:
        robot: shipped name or path of a robot file.
        quick: a part that takes some minutes: one size, pitch and x, fewer sines, two
            controllers and the robot's own servo profile, unless these are given.
        controllers: ``whole-body``, ``person``, ``zmp-tuned``, ``zmp-stock`` or any
            name as on the command line.
        servo_profiles: of the robot file; None for all it has.
        protocols: ``transient``, ``sinus``, ``prts``; all when None.
        axes: ``pitch``, ``roll``, ``x``, ``y``.
        sizes_deg: peak to peak; 0.5 to 16 when None. A translation goes as far as a
            tilt of this size moves a stiff body's centre of mass.
        frequencies_hz: of the sines.
        speed: of the ternary sequence.
        cycles: of the ternary sequence, three or more; the first one does not count.
        settings: for all runs, such as ``{"tsid.base_kp": 120.0}``.
        jobs: processes; 0 for one per processor.
        scheduler: address of a Dask scheduler, whose workers do the runs instead.
        out: a folder that keeps runs, page and YAML files; None keeps nothing.
        bar: shows how many runs are done.

    Raises:
        UsageError: a name is unknown or a number out of range, or the folder holds
            other files.
    """
    sizes = sizes_deg or (QUICK_SIZES_DEG if quick else SIZES_DEG)
    sines = frequencies_hz or (QUICK_FREQUENCIES_HZ if quick else FREQUENCIES_HZ)
    all_axes = QUICK_AXES if quick else AXES
    stimuli_of = known_names(protocols or PROTOCOLS, PROTOCOLS, what="--protocols")
    about = known_names(axes or all_axes, AXES, what="--axes")
    check_used(frequencies_hz is not None, "sinus", stimuli_of, what="frequencies_hz")
    check_used(speed != 1.0, "prts", stimuli_of, what="--speed")
    check_used(cycles != LEAST_CYCLES, "prts", stimuli_of, what="--cycles")
    if not LEAST_CYCLES <= cycles <= MOST_CYCLES:
        raise UsageError(
            f"--cycles: got {cycles}, expected {LEAST_CYCLES} to {MOST_CYCLES}"
        )
    check_positive(sizes, what="--sizes")
    check_positive(sines, what="frequencies_hz")
    check_positive([speed], what="--speed")
    if sorted({*sizes}) != [*sizes] or sizes[-1] > LARGEST_DEG:
        got = ",".join(f"{size:g}" for size in sizes)
        raise UsageError(
            f"--sizes: got {got}, expected degrees in ascending order, each once, "
            f"{LARGEST_DEG:g} at most"
        )
    stimuli = list(_stimuli(stimuli_of, about, sizes, sines, speed, cycles))
    under = everyone(robot, controllers, servo_profiles, quick=quick)
    subject = subject_of(robot)
    try:
        cells = [
            sway_cell(stimulus, who, height_m=subject.com_height_m)
            for stimulus in stimuli
            for who in under
        ]
    except ValueError as error:  # the motion is impossible
        raise UsageError(f"--speed {speed:g}: {error}") from error
    with bench_runs(
        "comtest",
        seen_by=sway_cell.__module__,
        robot=robot,
        settings=settings,
        jobs=jobs,
        scheduler=scheduler,
        out=out,
        bar=bar,
    ) as run:
        rows = run(cells, title="comtest")
    results = [sway_result(cell, row) for cell, row in zip(cells, rows, strict=True)]
    place = None if out is None else Path(out)
    asked = {"settings": dict(settings or {})}
    found = Comtest(robot, subject, results, place, asked)
    found.write()
    return found


def _stimuli(
    protocols: Sequence[Protocol],
    axes: Sequence[SwayAxis],
    sizes_deg: Sequence[float],
    frequencies_hz: Sequence[float],
    speed: float,
    cycles: int,
) -> Iterator[Stimulus]:
    for protocol, axis, size in product(protocols, axes, sizes_deg):
        if protocol == "sinus":
            for frequency_hz in frequencies_hz:
                yield Stimulus(protocol, axis, size, frequency_hz=frequency_hz)
        elif protocol == "prts":
            yield Stimulus(protocol, axis, size, speed=speed, cycles=cycles)
        else:
            yield Stimulus(protocol, axis, size)
