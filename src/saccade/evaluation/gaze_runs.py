"""Drives with each gaze policy, scored, and stored so that the study can be resumed."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import tau
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

import saccade
from saccade.errors import require
from saccade.evaluation.drives import summarize_drive
from saccade.evaluation.gaze_drives import LAPS, run_in_world
from saccade.evaluation.gaze_landmarks import COURSES, drive_by_landmarks, landmark_world
from saccade.evaluation.stored_runs import map_in_processes, read_run, write_run
from saccade.gaze import POLICIES, Gazer
from saccade.simulation.drive_config import WorldName
from saccade.visual import ObservationKind, VisualResult
from saccade.visual.config import EGOMOTIONS, EgomotionSource

Level = Literal["landmarks", "images"]
LEVELS: dict[str, tuple[str, ...]] = {"landmarks": tuple(COURSES), "images": tuple(LAPS)}
"""Worlds of each level."""
MAPS = "new", "known"
SCORES = "ate_m", "closed", "inside_3sigma"
"""Scores that are stored of each run."""
ALL_AROUND = "360"
"""A view in all directions at once: the bound, at the level of landmarks."""
LOOP_DISTANCE, LOOP_LANDMARKS = 5.0, 3
"""Metres that the robot travelled since it last observed the landmarks that close a loop, and how
many of them it re-identifies in one frame."""


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
        around = run.policy == ALL_AROUND
        options = {"fov": tau} if around else {}
        world = landmark_world(run.world)
        policy = "fixed" if around else policy
        return asdict(drive_by_landmarks(world, policy, run.seed, run.map == "known", **options))
    world_name = cast("WorldName", run.world)
    drive, result = run_in_world(world_name, policy, run.seed, run.frames, run.egomotion)
    summary = summarize_drive(drive, result)
    closed = first_closure(result) is not None
    return {name: summary[name] for name in ("ate_m", "inside_3sigma")} | {"closed": float(closed)}


def _constant(gazer: Gazer, pan: float) -> float:
    return pan


def first_closure(result: VisualResult) -> int | None:
    """The first frame that closes a loop, see `LOOP_DISTANCE`; None where none does."""
    steps = np.hypot(*np.diff(result.trajectory.pose[:, :2], axis=0).T)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    observed, last = result.observations, dict[int, float]()
    closing = np.zeros(len(travelled), np.int64)
    columns = (observed.frame, observed.landmark, observed.kind)
    for frame, landmark, kind in zip(*(column.tolist() for column in columns), strict=True):
        since = travelled[frame] - last.get(landmark, travelled[frame])
        closing[frame] += kind == ObservationKind.REIDENTIFIED and since >= LOOP_DISTANCE
        last[landmark] = travelled[frame]
    frames = np.flatnonzero(closing >= LOOP_LANDMARKS)
    return int(frames[0]) if len(frames) else None
