"""Monte Carlo consistency test of a filter: NEES over many runs in one world."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from saccade.simulation.world import WorldConfig, simulate_world
from saccade.slam import EkfConfig, run
from saccade.slam.config import RETRACTIONS
from saccade.slam.consistency import chi_square_band, pose_nees
from saccade.types import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarloRuns:
    """Errors of several runs at every pose."""

    nees: FloatArray
    """(runs, t) normalized estimation error squared of the pose, in the filter's error
    coordinates; 3 is expected. NaN where the pose is still exact."""
    squared_error: FloatArray
    """(runs, t) of the position, in square metres."""

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


def run_monte_carlo(
    world: WorldConfig, config: EkfConfig, runs: int, seed: int = 0
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """NEES (t,) and squared position error (t,) of each run; the seed of run i is `seed + i`."""
    for number in range(runs):
        log = simulate_world(world, seed + number)
        estimate = run(log, config).trajectory
        assert log.truth is not None
        error = (estimate.pose - log.truth.pose)[:, :2]
        yield pose_nees(estimate, log.truth, RETRACTIONS[config.filter]), np.square(error).sum(1)
