"""Landmark selection criteria at equal budgets, in simulation and on recorded drives.

    uv run python benchmarks/selection.py kitti07 kitti_stereo_60m --seeds 10 --jobs 2

Quoted in docs/selection.md. Drives a simulated ring and a simulated room, and recorded drives out
and back. Printed are the means of each drive and budget over the seeds, and over all of them the
mean rank of each criterion, and the ratios of its ATE and its re-identification rate to those of
the reference, with 95 % intervals over drives and seeds.

Tables are (drives, budgets, criteria, seeds), NaN where a run has no such score.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import rankdata
from threadpoolctl import threadpool_limits

from measuring import arguments, geometric_mean, in_processes, with_interval
from out_and_back import OutAndBackConfig, out_and_back
from saccade import datasets, visual
from saccade.evaluation.runs import summarize_drive
from saccade.frames import Drive
from saccade.simulation import DriveConfig, simulate_drive
from saccade.types import FloatArray
from saccade.visual import VisualConfig
from saccade.visual.config import SELECTIONS, Selection

WORLDS = {
    "ring": DriveConfig(size=(7.0, 5.5), frames_per_lap=120),
    "room": DriveConfig(
        size=(7.5, 7.0),
        corridor=3.0,
        poster_spacing=1.1,
        turning_radius=1.6,
        frames_per_lap=120,
    ),
}
"""Simulated drives, with other walls, photographs and noise for each seed."""
SCORES = {
    "reidentification_rate": ("re-id [%]", 100, ".1f"),
    "association_precision": ("precision [%]", 100, ".1f"),
    "ate_m": ("ATE [m]", 1, ".3f"),
    "inside_3sigma": ("consistent [%]", 100, ".1f"),
    "landmarks": ("map", 1, ".0f"),
}
"""Scores of a run, with their headings, factors and formats."""
RANKED = {"ate_m": 1, "reidentification_rate": -1}
"""Scores that rank the criteria, and their sign: smaller products are better."""


@dataclass(frozen=True)
class RunSeries:
    """Runs over one drive with one seed, which process the same frames."""

    seed: int
    source: str
    """A recorded drive, driven out and back, or one of `WORLDS`."""
    frames: int
    budgets: list[int]
    """Landmarks tracked at a time."""
    criteria: list[Selection]

    def load(self) -> Drive:
        """The drive, with each frame loaded once."""
        if self.source in WORLDS:
            world = replace(WORLDS[self.source], frames=self.frames)
            drive = simulate_drive(world, seed=self.seed)
        else:
            recorded = datasets.load_drive("auto", Path(self.source))
            drive = out_and_back(recorded, OutAndBackConfig(self.frames), self.seed)
        return replace(drive, load=cache(drive.load))


def run_series(series: RunSeries) -> FloatArray:
    """(budgets, criteria, scores) of a series."""
    drive, rows = series.load(), []
    for budget, criterion in product(series.budgets, series.criteria):
        config = VisualConfig(
            selection=criterion, new_per_frame=budget, max_tracked=budget, seed=series.seed
        )
        with threadpool_limits(1, user_api="blas"):
            found = summarize_drive(drive, visual.run(drive, config))
        attempts = found["reidentified"] + found["missed"]
        found["reidentification_rate"] = found["reidentified"] / attempts if attempts else None
        rows.append([found[score] for score in SCORES])
    return np.array(rows, np.float64).reshape(len(series.budgets), len(series.criteria), -1)


def ratios(table: FloatArray, reference: int) -> list[str]:
    """Ratio of each criterion's score to that of the reference, with its interval.

    Sums over the budgets are compared for each drive and seed, as budgets on the same drive are
    not independent. Drives on which a criterion has no score, or 0, are left out.
    """
    per_drive = np.nansum(table, axis=1).transpose(0, 2, 1).reshape(-1, table.shape[2])
    logs = np.log(per_drive[(per_drive > 0).all(1)])
    if len(logs) == 0:
        return ["-"] * table.shape[2]
    return [with_interval(geometric_mean(each - logs[:, reference])) for each in logs.T]


def main() -> None:
    given = arguments(
        __doc__,
        drives={"flags": "drives", "nargs": "*"},
        no_simulator=False,
        budgets=[5, 10, 20, 50],
        criteria={"nargs": "+", "choices": SELECTIONS, "default": list(SELECTIONS)},
        reference={"choices": SELECTIONS, "default": "rematch-rate-range"},
        seeds=5,
        first_seed=0,
        frames=160,
        jobs=1,
    )
    criteria = list(dict.fromkeys([*given.criteria, given.reference]))
    drives = [*([] if given.no_simulator else WORLDS), *given.drives]
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    series = [
        RunSeries(seed, source, given.frames, given.budgets, criteria)
        for seed, source in product(seeds, drives)
    ]
    runs = np.array([*in_processes(run_series, series, given.jobs)])
    runs = runs.reshape(len(seeds), len(drives), *runs.shape[1:])
    tables = dict(zip(SCORES, np.moveaxis(runs, (0, 4), (4, 0)), strict=True))
    for (d, drive), (b, budget) in product(enumerate(drives), enumerate(given.budgets)):
        print(f"\n{drive}, {budget} landmarks")
        print(" " * 24 + "".join(f"{heading:>16}" for heading, _, _ in SCORES.values()))
        for c, criterion in enumerate(criteria):
            cells = [
                f"{factor * np.nanmean(tables[score][d, b, c]):16{form}}"
                for score, (_, factor, form) in SCORES.items()
            ]
            print(f"{criterion:24}" + "".join(cells))
    ranks = [rankdata(sign * tables[score], axis=2) for score, sign in RANKED.items()]
    rank = np.nanmean(ranks, axis=(0, 1, 2, 4))
    reference = criteria.index(given.reference)
    relative = [ratios(tables[score], reference) for score in RANKED]
    print(f"\nall drives and budgets, relative to {given.reference}: rank, ATE, re-id rate")
    for c in np.argsort(rank, kind="stable"):
        print(f"{criteria[c]:24}{rank[c]:8.2f}  {'  '.join(each[c] for each in relative)}")


if __name__ == "__main__":
    main()
