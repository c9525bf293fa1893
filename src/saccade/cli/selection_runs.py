"""The runs of `saccade evaluate selection`: made once, kept, and gone on with."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any

from saccade import __version__

if TYPE_CHECKING:
    from saccade.frames import Drive
    from saccade.visual import FeatureCache, VisualConfig

CHOICES = {
    "strength": {"selection": "strength"},
    "random": {"selection": "random"},
    "range": {"selection": "range"},
    "contrast": {"selection": "contrast"},
    "symmetry": {"selection": "symmetry"},
    "must": {"detector": "must", "selection": "strength"},
    "symroid": {"detector": "symroid", "selection": "strength"},
    "rematch-rate": {"selection": "rematch-rate"},
    "rematch-rate-range": {"selection": "rematch-rate-range"},
    "rematch-rate-spread": {"selection": "rematch-rate-spread"},
}
"""What is compared: SIFT chosen in several ways, and two other detectors by strength."""
SCORES = ("found_again", "association_precision", "ate_m", "inside_3sigma", "landmarks", "end_m")
"""What is kept of each run, beside how long it took."""
SCORE = (float, int, NoneType)
LAP = 150
"""Frames of a lap of the simulated ring; its robot goes as far in one as in the default ring."""
RING = (7.0, 5.5)
"""Metres between its outer walls."""


@dataclass(frozen=True)
class Series:
    """The runs over one drive with one seed, which see the same frames."""

    source: Path | None
    """The recorded drive, driven out and back; None for the simulator."""
    seed: int
    """Of the noise, of the simulated world, and of what is chosen at random."""
    frames: int
    """Of the drive, at most."""
    budgets: tuple[int, ...]
    choices: tuple[str, ...]

    @property
    def world(self) -> str:
        """Its name."""
        return "simulator" if self.source is None else self.source.resolve().name

    def __len__(self) -> int:
        return len(self.budgets) * len(self.choices)

    def path(self, out: Path, budget: int, choice: str) -> Path:
        """Where a run is kept; another version makes its own."""
        name = f"{self.world}-{self.frames}-{budget}-{choice}-{self.seed}.json"
        return out / "runs" / __version__ / name


def run_all(series: Sequence[Series], out: Path, jobs: int) -> list[dict[str, Any]]:
    """The rows of all runs; several processes share the series among them."""
    from concurrent.futures import ProcessPoolExecutor
    from functools import partial
    from multiprocessing import get_context

    from saccade.cli.output import tracked

    work = partial(run_series, out=out)
    if jobs == 1:
        done = list(tracked(map(work, series), "driving", len(series)))
    else:
        with ProcessPoolExecutor(jobs, get_context("spawn"), _alone) as pool:
            done = list(tracked(pool.map(work, series), "driving", len(series)))
    return [row for rows in done for row in rows]


def _alone() -> None:
    """Leave the other processors to the other processes."""
    import cv2

    cv2.setNumThreads(1)


def run_series(series: Series, out: Path) -> list[dict[str, Any]]:
    """Make the runs that are not kept yet; all of them, in the order of budgets and choices."""
    return list(_runs(series, out))


def _runs(series: Series, out: Path) -> Iterator[dict[str, Any]]:
    from functools import cache

    from saccade.cli.output import write_text
    from saccade.visual import FeatureCache

    drive, memory = None, FeatureCache()
    for budget in series.budgets:
        for choice in series.choices:
            path = series.path(out, budget, choice)
            row = {"drive": series.world, "budget": budget, "choice": choice, "seed": series.seed}
            if path.exists():
                yield _kept(path, row)
                continue
            if drive is None:
                drive = _opened(series)
                drive = replace(drive, load=cache(drive.load))
            row |= _scored(drive, _settings(budget, choice, series.seed), memory)
            write_text(path, json.dumps(row, indent=2) + "\n")
            yield row


def _kept(path: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """A run that was made before, of what is asked for."""
    from saccade.errors import ConfigError
    from saccade.files import read_text, reason_of

    try:
        row: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason_of(error)}; delete it") from error
    made: dict[str, Any] = row if isinstance(row, dict) else {}
    scored = all(isinstance(made.get(name, ""), SCORE) for name in SCORES)
    if not scored or any(made.get(name) != asked[name] for name in asked):
        raise ConfigError(f"{path}: expected a run with its scores, found none; delete it")
    return made


def _opened(series: Series) -> "Drive":
    from saccade import datasets
    from saccade.evaluation.out_and_back import OutAndBackConfig, out_and_back
    from saccade.simulation import DriveConfig, simulate_drive

    if series.source is None:
        ring = DriveConfig(size=RING, frames_per_lap=LAP, frames=series.frames)
        return simulate_drive(ring, seed=series.seed)
    drive = datasets.load_drive("auto", series.source)
    return out_and_back(drive, OutAndBackConfig(series.frames), series.seed)


def _settings(budget: int, choice: str, seed: int) -> "VisualConfig":
    from saccade.visual import VisualConfig

    chosen: dict[str, Any] = CHOICES[choice]
    return replace(VisualConfig(new_per_frame=budget, max_tracked=10**5, seed=seed), **chosen)


def _scored(drive: "Drive", settings: "VisualConfig", memory: "FeatureCache") -> dict[str, Any]:
    from saccade import visual
    from saccade.cli.drive_files import summary

    row = summary(drive, visual.run(drive, settings, cache=memory))
    looked = row["recognized"] + row["missed"]
    row["found_again"] = row["recognized"] / looked if looked else None
    return {name: row[name] for name in (*SCORES, "recognized", "landmarks_seen", "ms_per_frame")}
