"""Means of scores over images or pairs, with bootstrap confidence intervals."""

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass
from math import isnan
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, Self, TypeVar

import numpy as np

from saccade.errors import ImageError
from saccade.types import FloatArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Name = TypeVar("Name")
Scores = TypeVar("Scores", bound="DataclassInstance")
"""A dataclass of floats."""

RESAMPLES = 2000
"""Number of bootstrap samples."""
CONFIDENCE = 0.95
"""Coverage probability of the bootstrap intervals."""


class Estimate(NamedTuple, Generic[Scores]):
    """Means of scores, with the limits of their bootstrap intervals."""

    mean: Scores
    low: Scores
    high: Scores

    def as_dict(self) -> dict[str, dict[str, float | None]]:
        """The scores by name, for the mean and both limits; None for unknown scores."""
        return {
            name: {key: None if isnan(value) else value for key, value in asdict(scores).items()}
            for name, scores in self._asdict().items()
        }


@dataclass(frozen=True, eq=False)
class ScoreSet(Generic[Name, Scores]):
    """The scores of each item, and their means with confidence intervals."""

    name: Sequence[Name]
    """Names of the items, in the order of `scores`."""
    scores: Sequence[Scores]
    """One dataclass of floats for each item."""
    seed: ClassVar[int]
    """Seed of the bootstrap, fixed so that equal scores have equal intervals."""

    def mean(self) -> Scores:
        """The mean of every score over the items."""
        return self._as_scores(self._table().mean(axis=0))

    def estimate(self) -> Estimate[Scores]:
        """The mean of every score with its bootstrap interval over the items."""
        return self._estimate(self._table())

    def minus(self, other: Self) -> Estimate[Scores]:
        """Means of the paired differences from another set, over common items.

        Raises:
            ImageError: the sets have no items in common.
        """
        theirs = dict(zip(other.name, other._table(), strict=True))
        ours = zip(self.name, self._table(), strict=True)
        differences = [row - theirs[name] for name, row in ours if name in theirs]
        if not differences:
            raise ImageError("scores: expected images that both scored, found none")
        return self._estimate(np.array(differences))

    def _table(self) -> FloatArray:
        return np.array([astuple(each) for each in self.scores])  # (items, scores)

    def _estimate(self, table: FloatArray) -> Estimate[Scores]:
        rows = table.mean(axis=0), *mean_interval(table, self.seed)
        return Estimate(*map(self._as_scores, rows))

    def _as_scores(self, values: FloatArray) -> Scores:
        scores: Any = type(self.scores[0])
        return scores(*values.tolist())  # type: ignore[no-any-return]


def mean_interval(table: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
    """Percentile bootstrap interval of the mean of each column, resampling rows.

    Args:
        table: (n, m) scores; for a single row both limits equal its values.
        seed: seed of the resampling.

    Returns:
        Lower and upper limits, (m,) each.
    """
    if len(table) < 2:
        return table.mean(axis=0), table.mean(axis=0)
    from scipy.stats import bootstrap  # slow to import

    interval = bootstrap(
        (table,),
        np.mean,
        axis=0,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return np.asarray(interval.low), np.asarray(interval.high)
