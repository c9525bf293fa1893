"""Consistency of the filters: Monte Carlo runs in simulated worlds, with known association.

    uv run python benchmarks/consistency.py
    uv run python benchmarks/consistency.py --wide --filters invariant

NEES of the pose, averaged over poses and runs: 3 for a consistent filter, more for an overconfident
one; in band: fraction of the poses at which the mean over the runs is inside its 95 % band.
Landmarks: the same of the landmarks at the end, 2 if consistent. Nonlinear: the root mean share of
second-order terms in the innovations' variance; doubtful over 0.12.
"""

import argparse
from dataclasses import replace

import numpy as np

from monte_carlo import MonteCarloRuns, run_monte_carlo
from saccade.settings import load_settings
from saccade.simulation import WorldConfig
from saccade.slam import EkfConfig
from saccade.slam.consistency import chi_square_band

FAR = WorldConfig(
    course_length=200.0,
    steps=1600,
    landmarks=30,
    landmark_spread=30.0,
    range_limits=(0.5, 40.0),
    range_percent=30.0,
    bearing_sigma_deg=10.0,
)
WORLDS = {name: load_settings("world", name) for name in ("loop", "slippery", "car", "coarse")}
WIDE = {
    "far": FAR,
    "sonar": replace(FAR, range_percent=5.0, bearing_sigma_deg=15.0),
    "precise": WorldConfig(range_percent=0.2, bearing_sigma_deg=0.1, odometry_percent=5.0),
    "turning": WorldConfig(odometry_percent=0.0, turn_sigma_deg=2.0),
    "skidding": WorldConfig(odometry_percent=10.0, range_limits=(0.5, 10.0), bearing_sigma_deg=5.0),
    "sparse": WorldConfig(landmarks=4, range_limits=(0.5, 12.0)),
    "narrow": WorldConfig(field_of_view_deg=60.0, range_limits=(0.5, 10.0)),
    "laps": WorldConfig(steps=2010),
    "exploring": WorldConfig(course_length=1000.0, landmarks=120),
    "radar": replace(FAR, landmark_spread=15.0, range_limits=(0.5, 20.0), range_percent=1.0),
}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("worlds", nargs="*", choices=[[], *WORLDS, *WIDE])
    parser.add_argument("--wide", action="store_true", help="ten other worlds")
    parser.add_argument("--filters", nargs="+", default=["standard", "invariant"])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    low, high = chi_square_band(3, given.runs)
    print(f"{given.runs} runs each, band {low:.2f} to {high:.2f}")
    print(f"{'':24}   NEES  landmarks  RMSE [m]  in band  nonlinear")
    for name in given.worlds or (WIDE if given.wide else WORLDS):
        world = (WORLDS | WIDE)[name]
        for kind in given.filters:
            config = EkfConfig(filter=kind, association="known")
            trials = run_monte_carlo(world, config, given.runs, given.seed)
            result = MonteCarloRuns(*(np.array(each) for each in zip(*trials, strict=True)))
            print(
                f"{f'{name}, {kind}':24} {result.anees:6.2f}  {result.landmark_anees:9.2f}"
                f"  {result.rmse:8.3f}  {result.in_band:7.0%}  {result.mean_nonlinearity:9.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
