"""DYSTURBANCE on a robot that only holds its posture."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec
import pytest
import yaml

from surefoot.bench import dysturbance
from surefoot.bench.bench_runs import PERSON, Under, bench_runs
from surefoot.bench.dysturbance_bench import Dysturbance
from surefoot.bench.push_cells import WITHIN, Disturbance, PushCell, push_cell
from surefoot.errors import UsageError
from surefoot.presentation import no_bar
from surefoot.studies.store import RUNS
from tests.surefoot import own_controllers

ROUNDED = 1e-3


def measure(out: Path) -> Dysturbance:
    return dysturbance(
        controllers=["hold"],
        servo_profiles=["ideal"],
        kinds=["impulse"],
        directions_deg=[0.0],
        jobs=1,
        out=out,
    )


@pytest.mark.closed_loop
def test_a_margin_is_found_kept_and_put_in_proportion(tmp_path: Path) -> None:
    out = tmp_path / "dysturbance"
    found = measure(out)
    (result,) = found.results
    assert result.fell is not None
    assert 0.0 < result.stood < result.fell <= WITHIN * result.stood * (1.0 + ROUNDED)
    assert result.absorbed is not None
    assert 0.0 < result.absorbed < 1.0
    assert result.margin == result.seen["peak_n"]
    (margin,) = out.glob("eurobench/hold_ideal/impulse_0_deg/stability_margin.yaml")
    values = yaml.safe_load(margin.read_text())["value"]
    assert values == [result.margin, result.normalised]
    assert "hold" in (out / "index.html").read_text()
    told = msgspec.json.decode((out / "dysturbance.json").read_bytes())
    assert told["results"][0]["margin"] == result.margin
    assert (told["body"], told["settings"]) == ("torso", {})
    assert "torso" in (out / "index.html").read_text()

    # Files of another set of sizes go, what is not ours stays.
    old, own = out / "eurobench" / "old.yaml", out / "eurobench" / "mine.yaml"
    old.write_bytes(margin.read_bytes())
    own.write_text("mine: 1\n")
    rows = (out / RUNS).read_bytes()
    assert rows.count(b"\n") == result.runs
    again = measure(out)
    assert (out / RUNS).read_bytes() == rows
    assert again.as_dict() == found.as_dict()
    assert own.is_file()
    assert margin.is_file()
    assert not old.exists()


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"kinds": ["shove"]}, "--kinds: got"),
        ({"frequencies_hz": [0.0]}, "--frequencies: got 0,"),
        ({"frequencies_hz": [1.0, 600.0]}, "--frequencies: got 600 Hz, expected"),
        ({"frequencies_hz": [1e-4]}, "--frequencies: a sine is too slow; .* got"),
        (
            {"kinds": ["impulse"], "frequencies_hz": [1.0]},
            "--frequencies: got a value, but only sine-displacement reads it",
        ),
        ({"body": "foo"}, "--body: got 'foo', expected one of"),
        ({"directions_deg": [float("nan")]}, "--directions: got"),
        ({"controllers": ["me"]}, "me"),
    ],
)
def test_what_cannot_be_measured_is_refused(
    tmp_path: Path, wrong: dict[str, object], told: str
) -> None:
    with pytest.raises(UsageError, match=told):
        dysturbance(**wrong, out=tmp_path / "out")  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_a_controller_changed_between_rounds_ends_the_bench(tmp_path: Path) -> None:
    source = tmp_path / "own.py"
    source.write_text(Path(own_controllers.__file__).read_text())
    under = Under(f"{source}:StayWithSettings", "ideal")

    def cell(size: float) -> PushCell:
        impulse = Disturbance("impulse", 0.0)
        made = push_cell(impulse, size, under, subject=PERSON, body="torso")
        brief = msgspec.structs.replace(made.scenario, duration_s=0.02)
        return dataclasses.replace(made, scenario=brief)

    with bench_runs(
        "dysturbance",
        seen_by="surefoot.bench.push_cells",
        robot="walker",
        settings=None,
        jobs=1,
        scheduler=None,
        out=tmp_path / "out",
        bar=no_bar,
    ) as run:
        run([cell(0.1)], title="round 1")
        source.write_text(source.read_text() + "\n# another one\n")
        with pytest.raises(UsageError, match="were changed; runs of both would be"):
            run([cell(0.2)], title="round 2")
