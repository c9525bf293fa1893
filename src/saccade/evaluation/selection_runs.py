"""Runs over drives with each landmark selection criterion, stored so that they can be resumed."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

import saccade
from saccade import datasets, visual
from saccade.evaluation.drives import summarize_drive
from saccade.evaluation.out_and_back import OutAndBackConfig, out_and_back
from saccade.evaluation.stored_runs import map_in_processes, read_run, write_run
from saccade.frames import Drive
from saccade.simulation import DriveConfig, simulate_drive
from saccade.visual import FeatureCache, VisualConfig
from saccade.visual.config import SELECTIONS

CRITERIA: dict[str, dict[str, Any]] = {
    **{name: {"selection": name} for name in SELECTIONS},
    **{
        detector if name == "strength" else f"{detector}-{name}": {
            "detector": detector,
            "selection": name,
        }
        for detector in ("must", "symroid")
        for name in SELECTIONS
    },
}
"""Settings of each criterion: a ranking of SIFT keypoints, or of another detector's; a detector
alone ranks by its response."""
COMPARED = (
    "rematch-rate-range",
    "rematch-rate",
    "strength",
    "symmetry",
    "must",
    "must-rematch-rate",
    "symroid",
    "symroid-rematch-rate",
)
"""Criteria that are compared by default."""
SCORES = (
    "reidentification_rate",
    "association_precision",
    "ate_m",
    "inside_3sigma",
    "landmarks",
    "end_m",
)
"""Scores that are stored of each run, beside its time."""
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


@dataclass(frozen=True)
class RunSeries:
    """The runs over one drive with one seed, which process the same frames."""

    source: Path | str
    """A recorded drive, driven out and back, or one of `WORLDS`."""
    seed: int
    """Seed of the noise, of the simulated world, and of the random selection."""
    frames: int
    """Maximum number of frames of the drive."""
    budgets: tuple[int, ...]
    """Landmarks tracked at a time."""
    criteria: tuple[str, ...]

    @property
    def drive(self) -> str:
        """Name of the drive."""
        if isinstance(self.source, Path):
            return self.source.resolve().name
        return f"simulated {self.source}"

    def path(self, out: Path, budget: int, criterion: str) -> Path:
        """The file of a run; each version of the package has its own."""
        name = f"{self.drive}-{self.frames}-{budget}-{criterion}-{self.seed}.json".replace(" ", "-")
        return out / "runs" / saccade.__version__ / name


def run_all(
    series: Sequence[RunSeries],
    out: Path,
    jobs: int = 1,
    progress: Callable[[int, int], object] | None = None,
) -> list[dict[str, Any]]:
    """The results of all runs, computed in `jobs` processes where they are not stored yet.

    Args:
        series: the runs.
        out: folder in which they are stored.
        jobs: number of processes; with several, each has a single OpenCV thread.
        progress: called with the series done and their number.
    """
    results = map_in_processes(partial(run_series, out=out), series, jobs, progress)
    return [row for rows in results for row in rows]


def run_series(series: RunSeries, out: Path) -> list[dict[str, Any]]:
    """The results of a series in the order of budgets and criteria; missing ones are computed."""
    return list(_runs(series, out))


def _runs(series: RunSeries, out: Path) -> Iterator[dict[str, Any]]:
    drive, features = None, FeatureCache()
    for budget in series.budgets:
        for criterion in series.criteria:
            path = series.path(out, budget, criterion)
            row: dict[str, Any] = {
                "drive": series.drive,
                "budget": budget,
                "criterion": criterion,
                "seed": series.seed,
            }
            if path.exists():
                yield read_run(path, row, SCORES)
                continue
            if drive is None:
                drive = _load(series)
                drive = replace(drive, load=cache(drive.load))
            config = VisualConfig(
                new_per_frame=budget, max_tracked=budget, shared_points=False, seed=series.seed
            )
            row |= _score(drive, replace(config, **CRITERIA[criterion]), features)
            write_run(path, row)
            yield row


def _load(series: RunSeries) -> Drive:
    if not isinstance(series.source, Path):
        world = replace(WORLDS[series.source], frames=series.frames)
        return simulate_drive(world, seed=series.seed)
    drive = datasets.load_drive("auto", series.source)
    return out_and_back(drive, OutAndBackConfig(series.frames), series.seed)


def _score(drive: Drive, config: VisualConfig, features: FeatureCache) -> dict[str, Any]:
    with threadpool_limits(1, user_api="blas"):  # more are slower on matrices of this size
        result = visual.run(drive, config, cache=features)
    row = summarize_drive(drive, result)
    attempts = row["reidentified"] + row["missed"]
    row["reidentification_rate"] = row["reidentified"] / attempts if attempts else None
    stored = (*SCORES, "reidentified", "landmarks_observed", "ms_per_frame")
    return {name: row[name] for name in stored}
