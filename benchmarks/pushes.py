"""Pushes on a robot that walks, from all around and at any phase of its steps.

    python -m benchmarks.pushes [--impulse 30] [--count 16] [--servo-profile harmonic]
        [--controller zmp] [--figure pushes.svg] [--set KEY=VALUE]

The shipped `walk-push` with another push: the k-th comes from k/16 of a turn, at a time
drawn from two steps with seed k, that of the sensors' noise, too. Prints a line
for each and how many were walked through; ``--figure`` draws them.
"""

from __future__ import annotations

import argparse
import math
import random
from typing import Any, NamedTuple

import msgspec

import surefoot as sf

DIRECTIONS = 16
FROM_S, STEPS_S = 4.0, 1.6
"""Of the pushes: the first, and for how long they are drawn from."""
AFTER_S = 4.5
"""Of the run, after its push: five steps and more."""


class Pushed(NamedTuple):
    """A push, and what came of it."""

    angle: float
    at_s: float
    is_up: bool
    dcm_error_max_mm: float


def push(number: int, options: argparse.Namespace) -> Pushed:
    """Run one."""
    shipped = sf.load_scenario("walk-push")
    angle = math.tau * number / DIRECTIONS
    at_s = round(FROM_S + STEPS_S * random.Random(number).random(), 3)
    one = shipped.push[0]
    force = options.impulse / one.duration_s
    along = (force * math.cos(angle), force * math.sin(angle), 0.0)
    changed = msgspec.structs.replace(one, force_n=along, start_s=at_s)
    scenario = msgspec.structs.replace(
        shipped, push=[changed], duration_s=at_s + AFTER_S
    )
    settings: dict[str, Any] = dict(
        (key, msgspec.toml.decode(f"value = {value}")["value"])
        for key, _, value in (word.partition("=") for word in options.set)
    )
    run = sf.simulate(
        "walker",
        scenario,
        controller=options.controller,
        settings=settings or None,
        servo_profile=options.servo_profile,
        seed=number,
        record=False,
    )
    errors = run.result.dcm_error_max_mm or [math.nan]
    return Pushed(angle % math.tau, at_s, run.outcome.is_up, max(errors))


def draw(pushes: list[Pushed], path: str, *, title: str) -> None:
    """Draw them around: direction as the angle, time as the distance."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.2, 4.6), layout="constrained")
    axes = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    for is_up, colour, mark, word in (
        (True, "#2a7f62", "o", "walked on"),
        (False, "#c0392b", "X", "fell"),
    ):
        chosen = [p for p in pushes if p.is_up is is_up]
        axes.scatter(
            [p.angle for p in chosen],
            [p.at_s - FROM_S for p in chosen],
            c=colour,
            marker=mark,
            s=44,
            label=f"{word}: {len(chosen)}",
        )
    axes.set_ylim(-0.8, STEPS_S)
    axes.set_yticks([0.0, 0.8, 1.6])
    axes.set_xticks([0.0, math.pi / 2, math.pi, 3 * math.pi / 2])
    axes.set_xticklabels(["ahead", "left", "back", "right"])
    axes.set_title(title, fontsize=10)
    figure.legend(loc="lower center", ncols=2, frameon=False, fontsize=9)
    figure.savefig(path)


def main() -> None:
    """Read the command line, run, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--impulse", type=float, default=30.0, help="N s")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=DIRECTIONS)
    parser.add_argument("--servo-profile", default="ideal")
    parser.add_argument("--controller", default="whole-body")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--figure")
    options = parser.parse_args()
    pushes = []
    for number in range(options.first, options.first + options.count):
        pushes.append(done := push(number, options))
        print(
            f"{math.degrees(done.angle):5.1f} deg at {done.at_s:.3f} s: "
            f"{'up' if done.is_up else 'fell'}, DCM off by up to "
            f"{done.dcm_error_max_mm:.0f} mm",
            flush=True,
        )
    up = sum(p.is_up for p in pushes)
    title = f"{options.impulse:g} N s, {options.controller}, {options.servo_profile}"
    print(f"{title}: {up} of {len(pushes)} walked through")
    if options.figure:
        draw(pushes, options.figure, title=title)


if __name__ == "__main__":
    main()
