"""Consistency of the filters: Monte Carlo runs in simulated worlds, with known association.

    uv run python benchmarks/consistency.py                               (docs/measured.md)
    uv run python benchmarks/consistency.py --wide --errors invariant --biases with

NEES of the pose, averaged over poses and runs: 3 for a consistent filter, more for an overconfident
one; in band: fraction of the poses at which the mean over the runs is inside its 95 % band.
Landmarks: NEES of the landmarks at the end, 2 if consistent. Nonlinear: root mean fraction of
second-order terms in the variance of the innovations; doubtful over 0.12.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from measuring import arguments
from saccade.settings import load_settings
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam import EkfConfig, run, wrap
from saccade.slam.consistency import (
    chi_square_band,
    invariant_translation,
    pose_nees,
    regular_nees,
)
from saccade.types import FloatArray, LandmarkMap

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
BIASES = {"without": False, "with": True}
"""Whether the filter estimates odometry biases."""


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarloRuns:
    """Errors of several runs at every pose, with known association."""

    nees: FloatArray
    """(runs, t) NEES of the pose, in the filter's error coordinates; 3 is expected. NaN where the
    pose is still exact."""
    squared_error: FloatArray
    """(runs, t) squared errors of the position in square meters."""
    landmark_nees: FloatArray
    """(runs,) mean NEES of the landmarks at the end, in the same coordinates; 2 is expected."""
    nonlinearity: FloatArray
    """(runs,) see `SlamResult.nonlinearity`."""

    @property
    def landmark_anees(self) -> float:
        """Average NEES over landmarks and runs."""
        return float(np.nanmean(self.landmark_nees))

    @property
    def anees(self) -> float:
        """Average NEES over poses and runs."""
        return float(np.nanmean(self.nees))

    @property
    def band(self) -> tuple[float, float]:
        """95 % interval of the mean NEES over the runs at one pose."""
        return chi_square_band(3, len(self.nees))

    @property
    def in_band(self) -> float:
        """Fraction of the poses whose mean NEES lies in the band."""
        mean = self.nees[:, np.isfinite(self.nees).all(0)].mean(0)
        low, high = self.band
        return float(((mean >= low) & (mean <= high)).mean())

    @property
    def rmse(self) -> float:
        """RMSE of the position in meters."""
        return float(np.sqrt(self.squared_error.mean()))


def run_monte_carlo(
    world: WorldConfig, errors: str, runs: int, seed: int = 0, *, biases: bool = True
) -> MonteCarloRuns:
    """Runs a filter with this error parametrization in a world; the seed of run i is `seed + i`.

    `biases` tells whether the filter estimates odometry biases.
    """
    config = EkfConfig(
        errors=errors, association="known", smooth=False, estimate_systematic_errors=biases
    )
    rows = []
    for number in range(runs):
        log = simulate_world(world, seed + number)
        result = run(log, config)
        estimate = result.trajectory
        turn = float(log.truth.pose[-1, 2] - estimate.pose[-1, 2])
        nees = landmark_nees(result.map, log.landmark_truth, turn, errors)
        squared = np.square((estimate.pose - log.truth.pose)[:, :2]).sum(1)
        pose = pose_nees(estimate, log.truth, errors)
        rows.append((pose, squared, np.nanmean(nees), result.nonlinearity))
    return MonteCarloRuns(*(np.array(column) for column in zip(*rows, strict=True)))


def landmark_nees(
    estimate: LandmarkMap, truth: LandmarkMap, turn: float, errors: str
) -> FloatArray:
    """NEES (n,) of the landmarks of a map in the filter's error coordinates.

    NaN where the covariance is singular. `turn` is the true heading at the end minus the estimated
    one, in radians.
    """
    xy = truth.xy[np.searchsorted(truth.id, estimate.id)]
    error = xy - estimate.xy
    if errors == "invariant":
        angle = np.full(len(xy), wrap(turn))
        lever = np.stack([-estimate.xy[:, 1], estimate.xy[:, 0]], 1)
        error = invariant_translation(estimate.xy, xy, angle) + angle[:, None] * lever
    return regular_nees(error, estimate.covariance)


def main() -> None:
    given = arguments(
        __doc__,
        worlds={"nargs": "*", "default": [], "choices": [*WORLDS, *WIDE], "flags": "--worlds"},
        wide=False,
        errors=["standard", "invariant"],
        biases={"nargs": "+", "choices": [*BIASES], "default": [*BIASES]},
        runs=50,
        seed=0,
    )
    print(f"{given.runs} runs each, band", *(f"{x:.2f}" for x in chi_square_band(3, given.runs)))
    print(f"{'':40}   NEES  landmarks  RMSE [m]  in band  nonlinear")
    worlds = given.worlds or (WIDE if given.wide else WORLDS)
    for name, errors, biases in product(worlds, given.errors, given.biases):
        world = (WORLDS | WIDE)[name]
        found = run_monte_carlo(world, errors, given.runs, given.seed, biases=BIASES[biases])
        print(
            f"{f'{name}, {errors}, {biases} biases':40} {found.anees:6.2f}"
            f"  {found.landmark_anees:9.2f}  {found.rmse:8.3f}  {found.in_band:7.0%}"
            f"  {found.nonlinearity.mean():9.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
