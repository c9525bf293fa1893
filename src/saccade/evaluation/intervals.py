"""How sure a mean over images or pairs is."""

import numpy as np
from scipy.stats import bootstrap

from saccade.types import FloatArray

RESAMPLES = 2000


def mean_interval(table: FloatArray, confidence: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Lower and upper end of the mean of each column, by bootstrap over the rows.

    Args:
        table: (n, m) scores; with a single row its own values are both ends.
        confidence: probability of the interval.
        seed: of the resampling: the interval of the same scores is always the same.

    Returns:
        Two of (m,).
    """
    if len(table) < 2:
        return table.mean(axis=0), table.mean(axis=0)
    found = bootstrap(
        (table,),
        np.mean,
        axis=0,
        n_resamples=RESAMPLES,
        confidence_level=confidence,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return np.asarray(found.low), np.asarray(found.high)
