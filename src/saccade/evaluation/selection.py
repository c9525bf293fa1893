"""Which of several choices did best, over worlds, budgets and seeds.

Tables are (worlds, budgets, choices, seeds) throughout, NaN where a run had no such score.
"""

import numpy as np
from scipy.stats import rankdata

from saccade.evaluation.intervals import mean_interval
from saccade.types import FloatArray

CONFIDENCE = 0.95


def means(table: FloatArray) -> FloatArray:
    """Mean over the seeds, lower and upper end of its interval: (worlds, budgets, choices, 3).

    NaN where no run had the score.
    """
    found = np.full((*table.shape[:3], 3), np.nan)
    for cell in np.ndindex(table.shape[:3]):
        scores = table[cell]
        scores = scores[np.isfinite(scores)][:, None]
        if len(scores):
            low, high = mean_interval(scores, CONFIDENCE, seed=0)
            found[cell] = scores.mean(), low[0], high[0]
    return found


def mean_ranks(table: FloatArray, larger_is_better: bool) -> FloatArray:
    """(choices,) place of each, 1 the best, by its mean over the seeds; averaged over all others.

    Equal ones share the mean of their places; those without a score come last.
    """
    mean = means(table)[..., 0]
    worst = -np.inf if larger_is_better else np.inf
    mean = np.where(np.isfinite(mean), mean, worst)
    ranks = rankdata(-mean if larger_is_better else mean, axis=2)
    return np.asarray(ranks.mean((0, 1)))


def ratios(table: FloatArray, reference: int) -> FloatArray:
    """(choices, 3) how many times as large a score is as that of one of the choices.

    Of each drive, which is a world with a seed, the sums over the budgets are compared; given
    are the geometric mean over the drives and the ends of its interval, by bootstrap over the
    drives: budgets on the same drive do not count as another one. Drives on which a choice has
    no score, or 0, are left out.
    """
    per_drive = np.nansum(table, axis=1).transpose(0, 2, 1).reshape(-1, table.shape[2])
    per_drive = np.log(per_drive[(per_drive > 0).all(1)])
    if len(per_drive) == 0:
        return np.full((table.shape[2], 3), np.nan)
    gain = per_drive - per_drive[:, [reference]]
    low, high = mean_interval(gain, CONFIDENCE, seed=0)
    return np.asarray(np.exp(np.stack([gain.mean(0), low, high], 1)))
