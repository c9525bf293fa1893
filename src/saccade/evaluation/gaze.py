"""Gaze policies compared over worlds and seeds.

Tables are (worlds, policies, seeds) throughout, NaN where a run has no such score.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from saccade.evaluation.gaze_runs import SCORES, TIMES
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.trajectory import none_if_nan
from saccade.types import FloatArray

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class GazeScores:
    """The scores of all runs."""

    world: Sequence[str]
    policy: Sequence[str]
    seed: Sequence[int]
    tables: dict[str, FloatArray]
    """(worlds, policies, seeds) of each of `SCORES`."""
    entropy: FloatArray
    """(worlds, policies, seeds, TIMES) entropy of the pose over time, in nats."""

    @classmethod
    def of(cls, runs: Sequence[dict[str, Any]]) -> "GazeScores":
        """The tables of runs, their axes in the order of first appearance."""
        names = ("world", "policy", "seed")
        axes = [list(dict.fromkeys(run[name] for run in runs)) for name in names]
        shape = [len(axis) for axis in axes]
        tables = {name: np.full(shape, np.nan) for name in SCORES}
        entropy = np.full([*shape, TIMES], np.nan)
        for run in runs:
            cell = tuple(axis.index(run[name]) for name, axis in zip(names, axes, strict=True))
            entropy[cell] = run["entropy_over_time"]
            for name in SCORES:
                if run[name] is not None:
                    tables[name][cell] = run[name]
        world, policy, seed = axes
        return cls(world, policy, seed, tables, entropy)

    def rows(self) -> Iterator[dict[str, Any]]:
        """Mean, low and high of each score by world and policy; None where missing."""
        tables = {name: means(table) for name, table in self.tables.items()}
        for w, world in enumerate(self.world):
            for p, policy in enumerate(self.policy):
                row: dict[str, Any] = {"world": world, "policy": policy}
                for name, mean in tables.items():
                    present = np.isfinite(mean[w, p, 0])
                    row[name] = mean[w, p].tolist() if present else None
                yield row

    def comparison(self, reference: str) -> list[dict[str, Any]]:
        """Of each policy the ATE as a ratio to that of a reference, and the loops closed.

        The ratio is the geometric mean over worlds and seeds, with its interval by seeds: those of
        one seed are averaged over the worlds first.
        """
        logs = np.log(self.tables["ate_m"])
        chosen = [self.policy.index(reference)]
        gain = (logs - logs[:, chosen]).mean(0).T  # (seeds, policies)
        low, high = mean_interval(gain, CONFIDENCE, seed=0)
        ratio = np.exp(np.stack([gain.mean(0), low, high], 1))
        closed, inside = self.tables["closed"], self.tables["inside_3sigma"]
        return [
            {
                "policy": policy,
                "reference": reference,
                "ate_m_ratio": [none_if_nan(value) for value in ratio[p].tolist()],
                "closed": int(np.nansum(closed[:, p])),
                "drives": int(np.isfinite(closed[:, p]).sum()),
                "inside_3sigma": none_if_nan(float(np.nanmean(inside[:, p]))),
            }
            for p, policy in enumerate(self.policy)
        ]


def means(table: FloatArray) -> FloatArray:
    """Mean over the seeds with its interval: (worlds, policies, 3), NaN where missing."""
    result = np.full((*table.shape[:2], 3), np.nan)
    for cell in np.ndindex(table.shape[:2]):
        scores = table[cell][np.isfinite(table[cell])][:, None]
        if len(scores):
            low, high = mean_interval(scores, CONFIDENCE, seed=0)
            result[cell] = scores.mean(), low[0], high[0]
    return result
