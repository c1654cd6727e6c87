"""Walks over many grounds, terrains and pushes: how many are completed.

    python -m benchmarks.walks [--only tiles push] [--count 50] [--out FOLDER]
        [--controllers whole-body zmp] [--servo-profiles ideal harmonic]
        [--set KEY=VALUE] [--figure walks.svg] [--push-figure pushes.svg]

The k-th run of a line has noise seed k. Its terrain, its push and the phase of the
ground's motion at its start are drawn with k. Writes Markdown: completed walks with
Wilson's 95 % interval of their share, and the worst DCM error, placement error and
touchdown force among them. ``--out`` keeps finished runs to resume a study.
``--figure`` draws the shares of completed walks, ``--push-figure`` the pushes of the
first line with pushes. To add a line of your own, add an entry to ``LINES``.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

import msgspec

from benchmarks.lines import LineRun, pivot, run_all, share_in_words, study_options
from surefoot import load_scenario
from surefoot.schemas.motions import Axis, PrtsMotion
from surefoot.schemas.scenario import Platform, Scenario, Tile
from surefoot.schemas.scenario_robot import Delay, ModelError
from surefoot.schemas.walk_plan import Walk, WalkStep
from surefoot.studies.cell import Row, is_up
from surefoot.studies.summaries import success_interval

if TYPE_CHECKING:
    from matplotlib.projections.polar import PolarAxes

DIRECTIONS = 16
PUSH_FROM_S, PUSH_WITHIN_S = 4.0, 1.6
"""Earliest time of a push, and range of its draw, which is two steps [s]."""
AFTER_PUSH_S = 4.5
"""Duration of the run after its push: five steps or more [s]."""
HALF_WIDTH_M = 0.11
"""Half the width of the Walker's stance."""
TOES_M = 0.17
"""Front of the soles at the Walker's start, where tiles begin."""
replace = msgspec.structs.replace


def drawn(number: int, *, line: str) -> random.Random:
    """Return the random generator of a line's run."""
    return random.Random(f"{line} {number}")


def shipped(name: str) -> Callable[[int], Scenario]:
    """Return a line that is the same shipped scenario for every number."""
    return lambda number: load_scenario(name)


def later(name: str, *, within_s: float) -> Callable[[int], Scenario]:
    """Return a line that begins to walk later, at a random phase of its ground."""

    def make(number: int) -> Scenario:
        scenario = load_scenario(name)
        assert scenario.walk is not None
        wait = round(within_s * drawn(number, line=name).random(), 3)
        walk = replace(scenario.walk, start_s=scenario.walk.start_s + wait)
        return replace(scenario, walk=walk, duration_s=scenario.duration_s + wait)

    return make


def tiles(height_mm: float, tilt_deg: float) -> Callable[[int], Scenario]:
    """Return a line over unknown tiles, one under each foothold."""

    def make(number: int) -> Scenario:
        draw = drawn(number, line="tiles")
        scenario = load_scenario("walk-tiles")
        assert scenario.walk is not None
        high = max(0.08, 0.08 + 2.0 * (height_mm - 25.0) / 1e3)
        return replace(
            scenario,
            walk=replace(scenario.walk, height_m=high),
            tile=[
                uneven(clear(tile), draw, height_mm=height_mm, tilt_deg=tilt_deg)
                for tile in scenario.tile
            ],
        )

    return make


def borders(number: int) -> Scenario:
    """Return tiles like those of 25 mm and 5 deg, with borders under the footholds."""
    draw = drawn(number, line="borders")
    scenario = load_scenario("walk-tiles")
    ahead, aside = 0.4, 0.21
    moved = [
        replace(
            tile,
            center_m=[tile.center_m[0] + 0.5 * ahead, tile.center_m[1]],
            size_m=[ahead, aside],
        )
        for tile in scenario.tile
    ]
    return replace(
        scenario,
        tile=[uneven(tile, draw, height_mm=25.0, tilt_deg=5.0) for tile in moved],
    )


def clear(tile: Tile) -> Tile:
    """Return a tile without its part under the soles at the start."""
    (x, y), (length, width) = tile.center_m, tile.size_m
    begins, ends = max(x - 0.5 * length, TOES_M), x + 0.5 * length
    return replace(
        tile, center_m=[0.5 * (begins + ends), y], size_m=[ends - begins, width]
    )


def uneven(
    tile: Tile, draw: random.Random, *, height_mm: float, tilt_deg: float
) -> Tile:
    """Return a tile with another height and tilt, each drawn uniformly."""
    return replace(
        tile,
        height_m=round(draw.uniform(-height_mm, height_mm) / 1e3, 4),
        roll_deg=round(draw.uniform(-tilt_deg, tilt_deg), 2),
        pitch_deg=round(draw.uniform(-tilt_deg, tilt_deg), 2),
    )


def stop_and_go(number: int) -> Scenario:
    """Return a walk of 0.25 m/s that stands for two seconds after every four steps."""
    scenario = load_scenario("walk-flat-slow")
    steps = [
        WalkStep(
            side=("left", "right")[i % 2],
            position_m=[0.2 * (i + 1), (-1) ** i * HALF_WIDTH_M],
            double_s=2.0 if i % 4 == 3 else None,
        )
        for i in range(16)
    ]
    return replace(scenario, walk=Walk(start_s=1.0, step=steps))


def prts_in_place(number: int) -> Scenario:
    """Return steps in place on ground that tilts as in human balance studies."""
    scenario = load_scenario("walk-flat-slow")
    axis: Axis = "roll" if number % 2 else "pitch"
    start_s = round(1.0 + 8.0 * drawn(number, line="prts").random(), 3)
    steps = [
        WalkStep(side=("left", "right")[i % 2], position_m=[0.0, (-1) ** i * 0.11])
        for i in range(16)
    ]
    return replace(
        scenario,
        duration_s=start_s + 16.0,
        walk=Walk(start_s=start_s, step=steps, height_m=0.06),
        platform=[
            Platform(
                foot="both",
                motion=[PrtsMotion(axis=axis, peak_to_peak_deg=8.0, start_s=0.5)],
            )
        ],
    )


def push(impulse_n_s: float) -> Callable[[int], Scenario]:
    """Return a line of pushes: the k-th from k/16 of a turn, at a random time."""

    def make(number: int) -> Scenario:
        scenario = load_scenario("walk-push")
        [one] = scenario.push
        angle, at_s = push_of(number)
        force = impulse_n_s / one.duration_s
        along = [force * math.cos(angle), force * math.sin(angle), 0.0]
        return replace(
            scenario,
            push=[replace(one, force_n=along, start_s=at_s)],
            duration_s=at_s + AFTER_PUSH_S,
        )

    return make


def push_of(number: int) -> tuple[float, float]:
    """Return direction [rad] and time [s] of the k-th push."""
    angle = math.tau * (number % DIRECTIONS) / DIRECTIONS
    within_s = PUSH_WITHIN_S * drawn(number, line="push").random()
    return angle, round(PUSH_FROM_S + within_s, 3)


def kerb(number: int) -> Scenario:
    """Return level ground with a kerb of 30 to 70 mm that is not in the plan."""
    draw = drawn(number, line="kerb")
    scenario = load_scenario("walk-flat-slow")
    begins, deep = round(draw.uniform(0.7, 1.1), 3), 3.0
    top = Tile(
        center_m=[begins + 0.5 * deep, 0.0],
        size_m=[deep, 1.6],
        height_m=round(draw.uniform(0.03, 0.07), 4),
        roll_deg=round(draw.uniform(-2.0, 2.0), 2),
    )
    return replace(scenario, tile=[top], duration_s=11.0)


def stairs(number: int) -> Scenario:
    """Return three stairs of 10 cm, each off the plan by up to 15 mm."""
    draw = drawn(number, line="stairs")
    scenario = load_scenario("walk-stairs")
    off = [
        replace(tile, height_m=round(tile.height_m + draw.uniform(-0.015, 0.015), 4))
        for tile in scenario.tile
    ]
    return replace(scenario, tile=off)


def model_errors(number: int) -> Scenario:
    """Return a walk of a robot that differs slightly from the controller's model."""
    draw = drawn(number, line="model errors")
    scenario = load_scenario("walk-flat-slow")

    def either(size: float) -> list[float]:
        return [round(draw.choice((-size, size)), 5) for _ in range(3)]

    return replace(
        scenario,
        friction=0.4,
        model_error=ModelError(mass_scale=1.05, servo_kp_scale=0.9),
        delay=Delay(command_ms=3.0),
        sensors=replace(
            scenario.sensors,
            gyro_bias_rad_s=either(0.003),
            accel_bias_m_s2=either(0.05),
            force_bias_n=either(3.0),
            encoder_resolution_rad=1e-4,
        ),
    )


LINES = {
    "flat, 0.25 m/s": shipped("walk-flat-slow"),
    "flat, 0.46 m/s": shipped("walk-flat-quick"),
    "turn, 17 deg/s": shipped("walk-turn"),
    "sideways, 0.1 m/s": shipped("walk-sideways"),
    "stop and go": stop_and_go,
    "tiles, 25 mm, 5 deg": tiles(25.0, 5.0),
    "tiles, 35 mm, 8 deg": tiles(35.0, 8.0),
    "borders under the feet, 25 mm, 5 deg": borders,
    "unknown kerb of 30 to 70 mm": kerb,
    "soft mat": shipped("walk-soft"),
    "seesaw": shipped("walk-seesaw"),
    "slow platform": later("walk-platform-slow", within_s=8.0),
    "fast platform": later("walk-platform-fast", within_s=2.0),
    "PRTS of 8 deg, in place": prts_in_place,
    "push of 20 N s": push(20.0),
    "push of 30 N s": push(30.0),
    "stairs of 10 cm, off by up to 15 mm": stairs,
    "model errors": model_errors,
}
"""Kinds of walks by name."""


class WalkRun(LineRun):
    """One run of a walk."""

    figures = (
        "dcm_error_rms_mm",
        "dcm_error_max_mm",
        "touchdown_peak_n",
        "placement_error_max_mm",
        "steps_done",
        "steps_planned",
    )

    def scenario(self) -> Scenario:
        """Return the walk of its line and number."""
        return LINES[self.line](self.number)


def in_words(rows: Sequence[Row]) -> str:
    """Return how many walks were completed, and their worst figures."""
    walked, told = [row for row in rows if is_up(row)], share_in_words(rows)
    errors = [row["dcm_error_rms_mm"] for row in walked if row["dcm_error_rms_mm"]]
    if not errors:
        return told
    x, y = (max(axis) for axis in zip(*errors, strict=True))
    off = max(row["placement_error_max_mm"] or 0.0 for row in walked)
    peak = max(max(row["touchdown_peak_n"] or [0.0]) for row in walked)
    return f"{told}: {x:.1f}, {y:.1f}; {off:.0f}; {peak:.0f}"


def table(rows: Sequence[Row]) -> str:
    """Return the Markdown table: a row per line and a column per controller."""
    cells: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        column = f"{row['variant']}, {row['servo_profile']}"
        cells.setdefault((row["line"], column), []).append(row)
    return pivot("walk", cells, in_words).rstrip("\n")


def draw_shares(rows: Sequence[Row], path: str) -> None:
    """Draw the share of completed walks of each line, with its interval."""
    from matplotlib.figure import Figure

    lines = list(dict.fromkeys(row["line"] for row in rows))
    columns = list(dict.fromkeys((r["variant"], r["servo_profile"]) for r in rows))
    figure = Figure(figsize=(7.0, 0.8 + 0.34 * len(lines)), layout="constrained")
    axes = figure.add_subplot()
    for number, column in enumerate(columns):
        shares, below, above, places = [], [], [], []
        for place, line in enumerate(lines):
            up = [
                is_up(row)
                for row in rows
                if (row["line"], row["variant"], row["servo_profile"])
                == (line, *column)
            ]
            if not up:
                continue
            share = sum(up) / len(up)
            low, high = success_interval(sum(up), len(up))
            shares.append(100.0 * share)
            below.append(100.0 * (share - low))
            above.append(100.0 * (high - share))
            places.append(place + 0.2 * (number - 0.5 * (len(columns) - 1)))
        axes.errorbar(
            shares, places, xerr=(below, above), fmt="o", ms=5, label=", ".join(column)
        )
    axes.set_yticks(range(len(lines)), lines)
    axes.invert_yaxis()
    axes.set_xlim(0.0, 102.0)
    axes.set_xlabel("walked to the end, with 95 % interval [%]")
    axes.grid(axis="x", alpha=0.3)
    figure.legend(loc="outside upper center", ncols=len(columns), frameon=False)
    figure.savefig(path)


def draw_pushes(rows: Sequence[Row], path: str) -> None:
    """Draw pushes in polar form: direction as the angle, time as the radius."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2, 4.6), layout="constrained")
    axes = cast("PolarAxes", figure.add_subplot(projection="polar"))
    axes.set_theta_zero_location("N")
    for walked, colour, mark, word in (
        (True, "#2a7f62", "o", "walked on"),
        (False, "#c0392b", "X", "fell"),
    ):
        chosen = [row for row in rows if is_up(row) is walked]
        places = [push_of(row["seed"]) for row in chosen]
        axes.scatter(
            [angle for angle, _ in places],
            [at_s - PUSH_FROM_S for _, at_s in places],
            c=colour,
            marker=mark,
            s=44,
            label=f"{word}: {len(chosen)}",
        )
    axes.set_ylim(-0.8, PUSH_WITHIN_S)
    axes.set_yticks([0.0, 0.8, 1.6])
    axes.set_xticks([0.0, math.pi / 2, math.pi, 3 * math.pi / 2])
    axes.set_xticklabels(["ahead", "left", "back", "right"])
    first = rows[0]
    title = f"{first['line']}, {first['controller']}, {first['servo_profile']}"
    axes.set_title(title, fontsize=10)
    figure.legend(loc="lower center", ncols=2, frameon=False, fontsize=9)
    figure.savefig(path)


def main() -> int:
    """Read the command line, run, print and draw."""
    parser = study_options(__doc__, count=16)
    parser.add_argument("--servo-profiles", nargs="+", default=["ideal", "harmonic"])
    parser.add_argument("--figure", help="of how many were walked")
    parser.add_argument("--push-figure", help="of the first push line that was run")
    options = parser.parse_args()
    names = [n for n in LINES if any(word in n for word in options.only)]
    runs = [
        WalkRun(name, number, controller, profile)
        for name in names
        for controller in options.controllers
        for profile in options.servo_profiles
        for number in range(options.first, options.first + options.count)
    ]
    rows = run_all(runs, options, title="walks")
    print(table(rows))
    if options.figure:
        draw_shares(rows, options.figure)
    if options.push_figure:
        pushed = [row for row in rows if "push" in row["line"]]
        kinds = ("line", "variant", "servo_profile")
        first = [pushed[0][kind] for kind in kinds]
        of = [row for row in pushed if [row[kind] for kind in kinds] == first]
        draw_pushes(of, options.push_figure)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
