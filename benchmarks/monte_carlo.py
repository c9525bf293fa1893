"""Monte Carlo runs of a filter in a simulated world, for studies and tests of its consistency."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from saccade.errors import LogError
from saccade.landmark_names import renumber
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam import INVARIANT, EkfConfig, Retraction, run, wrap
from saccade.slam.config import RETRACTIONS
from saccade.slam.consistency import (
    chi_square_band,
    invariant_translation,
    pose_nees,
    regular_nees,
)
from saccade.types import FloatArray, LandmarkMap


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarloRuns:
    """Errors of several runs at every pose."""

    nees: FloatArray
    """(runs, t) normalized estimation error squared of the pose, in the filter's error
    coordinates; 3 is expected. NaN where the pose is still exact."""
    squared_error: FloatArray
    """(runs, t) of the position, in square metres."""
    landmark_nees: FloatArray
    """(runs,) mean NEES of the landmarks at the end, in the same coordinates; 2 is expected."""

    nonlinearity: FloatArray
    """(runs,) see `SlamResult.nonlinearity`."""

    @property
    def mean_nonlinearity(self) -> float:
        """Mean over the runs."""
        return float(self.nonlinearity.mean())

    @property
    def landmark_anees(self) -> float:
        """Average NEES over landmarks and runs."""
        return _finite_mean(self.landmark_nees)

    @property
    def anees(self) -> float:
        """Average NEES over poses and runs."""
        return float(np.nanmean(self.nees))

    @property
    def median(self) -> float:
        """Median over the runs of the mean NEES over the poses."""
        return float(np.median(np.nanmean(self.nees, 1)))

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
        """RMSE of the position, in metres."""
        return float(np.sqrt(self.squared_error.mean()))


def _finite_mean(values: FloatArray) -> float:
    """Mean of the finite values; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) > 0 else float("nan")


def run_monte_carlo(
    world: WorldConfig, config: EkfConfig, runs: int, seed: int = 0
) -> Iterator[tuple[FloatArray, FloatArray, float, float]]:
    """NEES (t,), squared position error (t,), mean landmark NEES and nonlinearity of each run.

    The seed of run i is `seed + i`.
    """
    for number in range(runs):
        log = simulate_world(world, seed + number)
        result = run(log, config)
        estimate, retraction = result.trajectory, RETRACTIONS[config.filter]
        assert log.truth is not None
        assert log.landmark_truth is not None
        turn = log.truth.pose[-1, 2] - estimate.pose[-1, 2]
        nees = landmark_nees(result.map, log.landmark_truth, float(turn), retraction)
        error = (estimate.pose - log.truth.pose)[:, :2]
        squared = np.square(error).sum(1)
        pose = pose_nees(estimate, log.truth, retraction)
        yield pose, squared, _finite_mean(nees), result.nonlinearity


def landmark_nees(
    estimate: LandmarkMap, truth: LandmarkMap, turn: float, retraction: Retraction
) -> FloatArray:
    """NEES of the landmarks of a map, in the filter's error parametrization.

    Args:
        estimate: (n) landmarks with covariance.
        truth: the true landmarks; those of the estimate are found by name.
        turn: the true heading at the end minus the estimated one, in radians.
        retraction: the filter's error parametrization, as in `pose_nees`.

    Returns:
        (n,) values, chi-square with two degrees if the filter is consistent; NaN where the
        covariance is singular.

    Raises:
        LogError: a landmark of the map is none of the true ones.
    """
    if estimate.covariance is None:
        raise LogError("estimate: expected a map with covariances, found one without")
    ids, _ = renumber(truth.id, truth.text_names, estimate.text_names)
    missing = estimate.names[~np.isin(estimate.id, ids)]
    if len(missing) > 0:
        raise LogError(f"truth: expected landmark {missing[0]}, found no true position of it")
    order = np.argsort(ids)
    xy = truth.xy[order][np.searchsorted(ids[order], estimate.id)]
    error = xy - estimate.xy
    if retraction == INVARIANT:
        angle = np.full(len(xy), wrap(turn))
        x, y = estimate.xy[:, 0], estimate.xy[:, 1]
        error = invariant_translation(estimate.xy, xy, angle) + angle[:, None] * np.stack(
            [-y, x], 1
        )
    return regular_nees(error, estimate.covariance)
