"""A scenario built in Python: push the robot harder until it falls.

    python examples/own_scenario.py [PLOT.png [DURATION_S]]

A scenario file in TOML has the same keys; see docs/reference/scenario-file.md in the
site, or ``surefoot run my-scenario.toml``.
"""

from __future__ import annotations

import sys

import surefoot as sf

FORCES_N = (100.0, 200.0, 300.0, 400.0)


def seesaw(push_n: float, *, duration_s: float = 4.0) -> sf.Scenario:
    """Return a scenario: the left foot's ground rolls, and a push goes to the left."""
    return sf.Scenario(
        name=f"seesaw, {push_n:g} N",
        duration_s=duration_s,
        platform=[
            sf.Platform(
                foot="left",
                # Degrees in scenarios, radians everywhere else.
                motion=[
                    sf.SineMotion(axis="roll", amplitude_deg=8.0, frequency_hz=0.5)
                ],
            )
        ],
        push=[
            sf.Push(
                body="torso",  # a link of the URDF
                force_n=(0.0, push_n, 0.0),
                start_s=0.5 * duration_s,
                duration_s=0.1,
            )
        ],
        # Standard deviations; without them the sensors are perfect.
        sensors=sf.Sensors(force_noise_n=2.0, gyro_noise_rad_s=0.002),
    )


def main(plot: str | None = None, duration_s: float | str = 4.0) -> None:
    """Run the scenario with each force."""
    tilts = []
    for force in FORCES_N:
        scenario = seesaw(force, duration_s=float(duration_s))
        run = sf.simulate("walker", scenario, seed=1)
        tilts.append(run.result.base_tilt_max_deg)
        print(
            f"{force:g} N: {run.outcome}, torso leaned by {tilts[-1]:.1f} deg at most"
        )

    if plot is not None:
        import matplotlib as mpl

        mpl.use("Agg")  # draw to a file: needs no screen
        import matplotlib.pyplot as plt

        figure, axis = plt.subplots(figsize=(6, 3.5), layout="tight")
        axis.plot(FORCES_N, tilts, "o-")
        axis.set_xlabel("push for 0.1 s [N]")
        axis.set_ylabel("largest tilt of the torso [deg]")
        figure.savefig(plot, dpi=120)
        print(f"wrote {plot}")


if __name__ == "__main__":
    main(*sys.argv[1:])
