"""Drives with each gaze policy, scored, and stored so that the study can be resumed."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import tau
from pathlib import Path
from typing import Any, Literal

import numpy as np

import saccade
from saccade.errors import require
from saccade.evaluation.drives import summarize_drive
from saccade.evaluation.gaze_drives import gaze_drive
from saccade.evaluation.gaze_landmarks import (
    COURSES,
    FIELD_OF_VIEW,
    drive_by_landmarks,
    landmark_world,
)
from saccade.evaluation.stored_runs import map_in_processes, read_run, write_run
from saccade.gaze import POLICIES, Gazer
from saccade.simulation import DriveConfig
from saccade.visual import LandmarkObservations, ObservationKind
from saccade.visual.config import EGOMOTIONS, EgomotionSource

PAN_DRIVE = DriveConfig(size=(7.0, 5.5), image_size=(240, 180), field_of_view=50.0)
"""A stereo camera that pans; the ring is smaller than by default."""
LAPS = {"ring": 2, "crossing": 1, "rooms": 1}
"""Of each drive with images; after each the robot is where it began."""
Level = Literal["landmarks", "images"]
LEVELS: dict[str, tuple[str, ...]] = {"landmarks": tuple(COURSES), "images": tuple(LAPS)}
"""Worlds of each level."""
MAPS = "new", "known"
SCORES = "ate_m", "closed", "inside_3sigma"
"""Scores that are stored of each run."""
ALL_AROUND = "360"
"""A view in all directions at once: the bound, at the level of landmarks."""
LOOP_LANDMARKS = 3
"""Landmarks that close a loop where they are re-identified."""


@dataclass(frozen=True)
class GazeRun:
    """One drive with one policy and one seed.

    Raises:
        ConfigError: a name that is none, or what a level has not.
    """

    world: str
    policy: str
    """A name of `POLICIES`, degrees to the left of a constant pan, or `ALL_AROUND`."""
    seed: int
    """Of the world's noise, and of what the policy draws."""
    level: Level = "landmarks"
    map: Literal["new", "known"] = "new"
    """Whether the map is made, or known before."""
    egomotion: EgomotionSource = "wheels"
    """What measures the motion."""
    frames: int = 200
    """Of a drive with images, at most."""

    def __post_init__(self) -> None:
        require(self.level in LEVELS, "level", f"one of {', '.join(LEVELS)}", self.level)
        require(self.map in MAPS, "map", f"one of {', '.join(MAPS)}", self.map)
        ego, worlds = self.egomotion, LEVELS[self.level]
        require(ego in EGOMOTIONS, "egomotion", f"one of {', '.join(EGOMOTIONS)}", ego)
        require(self.world in worlds, "world", f"one of {', '.join(worlds)}", self.world)
        by_images = self.level == "images"
        require(by_images or ego == "wheels", "egomotion", "wheels without images", ego)
        require(not by_images or self.map == "new", "map", "new with images", self.map)
        policies = (*POLICIES, "a pan in degrees") + (() if by_images else (ALL_AROUND,))
        known = self.policy in policies or self.policy.lstrip("-").isdecimal()
        known &= not (by_images and self.policy == ALL_AROUND)
        require(known, "policy", f"one of {', '.join(policies)}", self.policy)

    def path(self, out: Path) -> Path:
        """The file of the run; each version of the package has its own."""
        name = "-".join(str(value) for value in asdict(self).values())
        return out / "runs" / saccade.__version__ / f"{name}.json"

    @property
    def identity(self) -> dict[str, Any]:
        """What tells it from other runs."""
        return {"world": self.world, "policy": self.policy, "seed": self.seed}


def run_all(
    runs: Sequence[GazeRun],
    out: Path,
    jobs: int = 1,
    progress: Callable[[int, int], object] | None = None,
) -> list[dict[str, Any]]:
    """The results of all runs, computed in `jobs` processes where they are not stored yet.

    Args:
        runs: the runs.
        out: folder in which they are stored.
        jobs: number of processes; with several, each has a single OpenCV thread.
        progress: called with the runs done and their number.
    """
    return map_in_processes(partial(result_of, out=out), runs, jobs, progress)


def result_of(run: GazeRun, out: Path) -> dict[str, Any]:
    """The scores of a run, read from its file or computed."""
    path = run.path(out)
    if path.exists():
        return read_run(path, run.identity, SCORES)
    row = run.identity | score(run)
    write_run(path, row)
    return row


def score(run: GazeRun) -> dict[str, Any]:
    """The scores of a drive."""
    policy: Any = run.policy
    if policy not in POLICIES:
        policy = partial(_constant, pan=np.radians(float(policy)))
    if run.level == "landmarks":
        fov = tau if run.policy == ALL_AROUND else FIELD_OF_VIEW
        policy = "fixed" if run.policy == ALL_AROUND else policy
        world = landmark_world(run.world)
        return drive_by_landmarks(world, policy, run.seed, run.map == "known", fov)
    name: Any = run.world
    lap = max(2, run.frames // LAPS[name])
    config = replace(PAN_DRIVE, world=name, frames=run.frames, frames_per_lap=lap)
    drive, result = gaze_drive(config, policy, run.seed, egomotion=run.egomotion)
    scores = summarize_drive(drive, result)
    scores["closed"] = closes_loop(result.observations, run.frames)
    return {name: scores[name] for name in SCORES}


def _constant(gazer: Gazer, pan: float) -> float:
    return pan


def closes_loop(observed: LandmarkObservations, frames: int) -> bool:
    """Whether `LOOP_LANDMARKS` are re-identified at least half a drive after they were new."""
    _, first, index = np.unique(observed.landmark, return_index=True, return_inverse=True)
    age = observed.frame - observed.frame[first][index]
    again = (observed.kind == ObservationKind.REIDENTIFIED) & (age >= frames / 2)
    return len(np.unique(observed.landmark[again])) >= LOOP_LANDMARKS
