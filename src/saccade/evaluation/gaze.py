"""Gaze policies compared over worlds and seeds."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from saccade.evaluation.gaze_runs import SCORES
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.trajectory import none_if_nan

CONFIDENCE = 0.95


def compare(runs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of each policy the scores over all runs, and its ATE relative to other policies.

    A ratio is a geometric mean over worlds and seeds, with its interval by seeds: those of one seed
    are averaged over the worlds first.

    Args:
        runs: rows with world, policy, seed and `SCORES`, of all combinations.

    Returns:
        Rows with the policy, the median ATE in metres, the ratios [mean, low, high] to "fixed" and
        "sweep" (None without such runs), the ratios to "fixed" by world and the worst one, drives
        in which a loop was closed, their number, and the share of the poses inside 3 sigma.
    """
    names = "policy", "world", "seed"
    policies, worlds, seeds = (list(dict.fromkeys(run[name] for run in runs)) for name in names)
    found = {tuple(run[name] for name in names): run for run in runs}
    table = {
        score: np.array(
            [[[found[p, w, s][score] for s in seeds] for w in worlds] for p in policies], np.float64
        )
        for score in SCORES
    }
    log = np.log(table["ate_m"])  # (p, w, s)
    rows = []
    for p, policy in enumerate(policies):
        row: dict[str, Any] = {"policy": policy, "ate_m": float(np.exp(np.median(log[p])))}
        for reference in ("fixed", "sweep"):
            row[f"to_{reference}"] = None
            if reference in policies:
                gain = log[p] - log[policies.index(reference)]
                low, high = mean_interval(gain.mean(0)[:, None], CONFIDENCE, seed=0)
                ratio = np.exp([gain.mean(), low[0], high[0]])
                row[f"to_{reference}"] = [none_if_nan(value) for value in ratio.tolist()]
        if "fixed" in policies:
            gain = log[p] - log[policies.index("fixed")]
            row["worlds"] = dict(zip(worlds, np.exp(gain.mean(1)).tolist(), strict=True))
            row["worst"] = float(np.exp(gain.max()))
        row["closed"] = int(np.nansum(table["closed"][p]))
        row["drives"] = int(np.isfinite(table["ate_m"][p]).sum())
        row["inside_3sigma"] = none_if_nan(float(np.nanmean(table["inside_3sigma"][p])))
        rows.append(row)
    return rows
