"""Landmark selection criteria compared over drives, budgets and seeds.

Tables are (drives, budgets, criteria, seeds) throughout, NaN where a run has no such score.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy.stats import rankdata

from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.selection_runs import SCORES
from saccade.evaluation.trajectory import none_if_nan
from saccade.types import FloatArray

CONFIDENCE = 0.95
RANKED = {"ate_m": False, "reidentification_rate": True}
"""Scores that rank the criteria, and whether larger ones are better."""


@dataclass(frozen=True, eq=False)
class SelectionScores:
    """The scores of all runs."""

    drive: Sequence[str]
    budget: Sequence[int]
    """Landmarks tracked at a time."""
    criterion: Sequence[str]
    seed: Sequence[int]
    tables: dict[str, FloatArray]
    """(drives, budgets, criteria, seeds) of each of `SCORES`."""

    @classmethod
    def of(cls, runs: Sequence[dict[str, Any]]) -> "SelectionScores":
        """The tables of runs, their axes in the order of first appearance."""
        names = ("drive", "budget", "criterion", "seed")
        axes = [list(dict.fromkeys(run[name] for run in runs)) for name in names]
        tables = {score: np.full([len(axis) for axis in axes], np.nan) for score in SCORES}
        for run in runs:
            cell = tuple(axis.index(run[name]) for name, axis in zip(names, axes, strict=True))
            for score in SCORES:
                if run[score] is not None:
                    tables[score][cell] = run[score]
        drive, budget, criterion, seed = axes
        return cls(drive, budget, criterion, seed, tables)

    def rows(self) -> Iterator[dict[str, Any]]:
        """Mean, low and high of each score by drive, budget and criterion; None where missing."""
        tables = {score: means(table) for score, table in self.tables.items()}
        cells = [enumerate(axis) for axis in (self.drive, self.budget, self.criterion)]
        for (d, drive), (b, budget), (c, criterion) in product(*cells):
            row = {"drive": drive, "budget": budget, "criterion": criterion}
            for score, mean in tables.items():
                present = np.isfinite(mean[d, b, c, 0])
                row[score] = mean[d, b, c].tolist() if present else None
            yield row

    def ranking(self, reference: str) -> list[dict[str, Any]]:
        """The criteria over all drives and budgets, best first.

        Each has its mean rank by the scores of `RANKED`, and those scores as ratios to those of a
        reference, with their intervals, where that is among the criteria.
        """
        ranks = [mean_ranks(self.tables[score], larger) for score, larger in RANKED.items()]
        rank = np.mean(ranks, axis=0)
        rows: list[dict[str, Any]] = [
            {"criterion": name, "mean_rank": float(rank[i])}
            for i, name in enumerate(self.criterion)
        ]
        if reference in self.criterion:
            for score in RANKED:
                ratio = ratios(self.tables[score], self.criterion.index(reference))
                for row, values in zip(rows, ratio.tolist(), strict=True):
                    row[f"{score}_ratio"] = [none_if_nan(value) for value in values]
        return sorted(rows, key=lambda row: float(row["mean_rank"]))


def means(table: FloatArray) -> FloatArray:
    """Mean over the seeds with its interval: (drives, budgets, criteria, 3), NaN where missing."""
    result = np.full((*table.shape[:3], 3), np.nan)
    for cell in np.ndindex(table.shape[:3]):
        scores = table[cell]
        scores = scores[np.isfinite(scores)][:, None]
        if len(scores):
            low, high = mean_interval(scores, CONFIDENCE, seed=0)
            result[cell] = scores.mean(), low[0], high[0]
    return result


def mean_ranks(table: FloatArray, larger_is_better: bool) -> FloatArray:
    """(criteria,) rank by the mean over the seeds, averaged over drives and budgets; 1 is best.

    Ties share the mean of their ranks; criteria without a score rank last.
    """
    mean = means(table)[..., 0]
    worst = -np.inf if larger_is_better else np.inf
    mean = np.where(np.isfinite(mean), mean, worst)
    ranks = rankdata(-mean if larger_is_better else mean, axis=2)
    return np.asarray(ranks.mean((0, 1)))


def ratios(table: FloatArray, reference: int) -> FloatArray:
    """(criteria, 3) ratio of a score to that of the reference criterion, with its interval.

    Sums over the budgets are compared for each drive and seed, as budgets on the same drive are
    not independent. Given are the geometric mean and its bootstrap interval. Drives on which a
    criterion has no score, or 0, are left out.
    """
    per_drive = np.nansum(table, axis=1).transpose(0, 2, 1).reshape(-1, table.shape[2])
    per_drive = np.log(per_drive[(per_drive > 0).all(1)])
    if len(per_drive) == 0:
        return np.full((table.shape[2], 3), np.nan)
    gain = per_drive - per_drive[:, [reference]]
    low, high = mean_interval(gain, CONFIDENCE, seed=0)
    return np.asarray(np.exp(np.stack([gain.mean(0), low, high], 1)))
