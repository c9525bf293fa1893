"""Landmark selection criteria at equal budgets, in simulation and on recorded drives.

    uv run python benchmarks/selection.py kitti07 kitti_stereo_60m --seeds 10 --jobs 2

Drives a simulated ring and a simulated room, and recorded drives out and back. Every run is stored
in --out: an interrupted study resumes, and more seeds add to it. Printed are the means of each
drive and budget, and the criteria over all of them: their mean rank, and the ratios of their ATE
and re-identification rate to those of the reference, with 95 % intervals over the seeds.

Tables are (drives, budgets, criteria, seeds), NaN where a run has no such score.
"""

import argparse
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from saccade.evaluation.gaze import map_in_processes, read_run, write_run
from scipy.stats import rankdata
from threadpoolctl import threadpool_limits

import saccade
from out_and_back import OutAndBackConfig, out_and_back
from saccade import datasets, visual
from saccade.evaluation.intervals import mean_interval
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
RANKED = {"ate_m": False, "reidentification_rate": True}
"""Scores that rank the criteria, and whether larger ones are better."""


@dataclass(frozen=True)
class RunSeries:
    """Runs over one drive with one seed, which process the same frames."""

    source: str
    """A recorded drive, driven out and back, or one of `WORLDS`."""
    seed: int
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


def run_series(series: RunSeries, out: Path) -> list[dict[str, Any]]:
    """The results of a series; those that are not stored are computed."""
    drive, rows = None, []
    name = Path(series.source).resolve().name
    for budget, criterion in product(series.budgets, series.criteria):
        run = f"{name}-{series.frames}-{budget}-{criterion}-{series.seed}.json"
        path = out / "runs" / saccade.__version__ / run
        row = {"drive": name, "budget": budget, "criterion": criterion, "seed": series.seed}
        if not path.exists():
            drive = series.load() if drive is None else drive
            config = VisualConfig(
                selection=criterion,
                new_per_frame=budget,
                max_tracked=budget,
                seed=series.seed,
            )
            with threadpool_limits(1, user_api="blas"):
                result = visual.run(drive, config)
            found = summarize_drive(drive, result)
            attempts = found["reidentified"] + found["missed"]
            found["reidentification_rate"] = found["reidentified"] / attempts if attempts else None
            write_run(path, row | {score: found[score] for score in SCORES})
        rows.append(read_run(path, row, tuple(SCORES)))
    return rows


def means(table: FloatArray) -> FloatArray:
    """Mean over the seeds with its interval: (drives, budgets, criteria, 3), NaN where missing."""
    result = np.full((*table.shape[:3], 3), np.nan)
    for cell in np.ndindex(table.shape[:3]):
        scores = table[cell][np.isfinite(table[cell])][:, None]
        if len(scores):
            low, high = mean_interval(scores, 0.95, seed=0)
            result[cell] = scores.mean(), low[0], high[0]
    return result


def mean_ranks(table: FloatArray, larger_is_better: bool) -> FloatArray:
    """(criteria,) rank by the mean over the seeds, averaged over drives and budgets; 1 is best.

    Ties share the mean of their ranks; criteria without a score rank last.
    """
    mean = means(table)[..., 0]
    cost = np.nan_to_num(-mean if larger_is_better else mean, nan=np.inf)
    return np.asarray(rankdata(cost, axis=2).mean((0, 1)))


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
    low, high = mean_interval(gain, 0.95, seed=0)
    return np.asarray(np.exp(np.stack([gain.mean(0), low, high], 1)))


def print_scores(rows: list[dict[str, Any]], reference: str) -> None:
    """Print the means of each drive and budget, and the ranking over all."""
    names = ("drive", "budget", "criterion", "seed")
    axes = [list(dict.fromkeys(row[name] for row in rows)) for name in names]
    drives, budgets, criteria, _ = axes
    tables = {score: np.full([len(axis) for axis in axes], np.nan) for score in SCORES}
    for row in rows:
        cell = tuple(axis.index(row[name]) for name, axis in zip(names, axes, strict=True))
        for score, table in tables.items():
            table[cell] = np.nan if row[score] is None else row[score]
    averages = {score: means(table) for score, table in tables.items()}
    for (d, drive), (b, budget) in product(enumerate(drives), enumerate(budgets)):
        print(f"\n{drive}, {budget} landmarks")
        print(" " * 24 + "".join(f"{heading:>20}" for heading, _, _ in SCORES.values()))
        for c, criterion in enumerate(criteria):
            cells = []
            for score, (_, factor, form) in SCORES.items():
                mean, low, high = factor * averages[score][d, b, c]
                cells.append(f"{mean:{form}} ±{(high - low) / 2:{form}}")
            print(f"{criterion:24}" + "".join(f"{cell:>20}" for cell in cells))
    rank = np.mean([mean_ranks(tables[score], larger) for score, larger in RANKED.items()], 0)
    relative = {score: ratios(tables[score], criteria.index(reference)) for score in RANKED}
    print(f"\nall drives and budgets, relative to {reference}: mean rank, ATE, re-id rate")
    for c in np.argsort(rank, kind="stable"):
        cells = [
            f"{m:.2f} [{low:.2f} {high:.2f}]"
            for m, low, high in (relative[score][c] for score in RANKED)
        ]
        print(f"{criteria[c]:24}{rank[c]:8.2f}  {'  '.join(cells)}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("drives", nargs="*")
    parser.add_argument("--out", type=Path, default=Path("saccade-selection"))
    parser.add_argument("--no-simulator", action="store_true")
    parser.add_argument("--budgets", nargs="+", type=int, default=[5, 10, 20, 50])
    parser.add_argument("--criteria", nargs="+", choices=SELECTIONS, default=SELECTIONS)
    parser.add_argument("--reference", choices=SELECTIONS, default="rematch-rate-range")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=160)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    criteria = list(dict.fromkeys([*given.criteria, given.reference]))
    sources = [*([] if given.no_simulator else WORLDS), *given.drives]
    series = [
        RunSeries(source, seed, given.frames, given.budgets, criteria)
        for seed in range(given.first_seed, given.first_seed + given.seeds)
        for source in sources
    ]
    results = map_in_processes(partial(run_series, out=given.out), series, given.jobs)
    print_scores([row for rows in results for row in rows], given.reference)


if __name__ == "__main__":
    main()
