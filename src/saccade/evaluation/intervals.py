"""Means of scores over images or pairs, with bootstrap confidence intervals."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import numpy as np
from scipy.stats import bootstrap

from saccade.types import FloatArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Name = TypeVar("Name")
Scores = TypeVar("Scores", bound="DataclassInstance")

RESAMPLES = 2000


@dataclass(frozen=True, eq=False)
class ScoreSet(Generic[Name, Scores]):
    """The scores of each item, and their means with confidence intervals."""

    name: Sequence[Name]
    """Names of the items, in the order of `scores`."""
    scores: Sequence[Scores]
    """One dataclass of floats for each item."""
    seed: ClassVar[int]
    """Seed of the bootstrap: equal scores always have equal intervals."""

    def mean(self) -> Scores:
        """The mean of every score over the items."""
        return self._as_scores(self._table().mean(axis=0))

    def interval(self, confidence: float = 0.95) -> tuple[Scores, Scores]:
        """Lower and upper end of each mean's bootstrap interval over the items."""
        low, high = mean_interval(self._table(), confidence, self.seed)
        return self._as_scores(low), self._as_scores(high)

    def _table(self) -> FloatArray:
        return np.array([astuple(each) for each in self.scores])  # (items, scores)

    def _as_scores(self, values: FloatArray) -> Scores:
        scores: Any = type(self.scores[0])
        return scores(*values.tolist())  # type: ignore[no-any-return]


def mean_interval(table: FloatArray, confidence: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Percentile bootstrap interval of the mean of each column, resampling rows.

    Args:
        table: (n, m) scores; with a single row its own values are both ends.
        confidence: probability of the interval.
        seed: seed of the resampling.

    Returns:
        Lower and upper ends, (m,) each.
    """
    if len(table) < 2:
        return table.mean(axis=0), table.mean(axis=0)
    interval = bootstrap(
        (table,),
        np.mean,
        axis=0,
        n_resamples=RESAMPLES,
        confidence_level=confidence,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return np.asarray(interval.low), np.asarray(interval.high)
