"""Searches settings of the ZMP baseline, as a call of ``surefoot tune``.

    python -m benchmarks.tune_zmp [--trials 200] [--workers 0] [--out DIR]
                                  [--servo-profile NAME]

Begins at the published values (zmp-stock) with the whole-body controller's margin to
the true friction, on the scenarios of benchmarks/training, none of which ships. What
was found is compared with the start on shipped ones.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import surefoot as sf

TRAINING = sorted((Path(__file__).parent / "training").glob("*.toml"))
HELD_OUT = ("moving-platform-fast", "two-platforms-slow", "tilt-ramp-diagonal")
PARAMS = {
    "zmp.cop_admittance": (0.005, 0.1),
    "zmp.dfz_admittance": (5e-5, 5e-4),
    "zmp.max_fdc_velocity_rad_s": (0.2, 3.0),
    "zmp.max_vertical_velocity_m_s": (0.1, 1.0),
    "zmp.level_base": (0.0, 1.0),
    "zmp.level_height": (0.0, 1.0),
    "zmp.com_weight": (1e3, 1e5),
    "zmp.contact_damping": (150.0, 300.0),
    "zmp.dcm_prop_gain": (1.0, 5.0),
    "zmp.dcm_integral_gain": (5.0, 20.0),
    "zmp.dcm_deriv_gain": (0.0, 0.5),
    "zmp.dcm_bias": ["off", "bias", "filter"],
    "zmp.com_admittance": (0.0, 0.5),
    "zmp.dfz_damping": (0.0, 0.5),
    "zmp.vdc_frequency": (0.5, 2.0),
}


def main() -> int:
    """Read the command line and search."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--servo-profile")
    parser.add_argument("--out", type=Path, default=Path("out/tune-zmp"))
    arguments = parser.parse_args()
    tuned = sf.tune(
        [str(path) for path in TRAINING],
        PARAMS,
        trials=arguments.trials,
        workers=arguments.workers,
        out=arguments.out,
        held_out=HELD_OUT,
        controller="zmp",
        settings="zmp-stock",
        overrides=["zmp.friction=0.6"],
        servo_profile=arguments.servo_profile,
    )
    print(*tuned.words, f"wrote {arguments.out}/settings.toml", sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
