"""Drives with each gaze policy, scored, and stored so that the study can be resumed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import saccade
from saccade.evaluation.drives import summarize_drive
from saccade.evaluation.gaze_drives import run_in_world
from saccade.evaluation.stored_runs import map_in_processes, read_run, write_run
from saccade.frames import Drive
from saccade.simulation.drive_config import WorldName
from saccade.types import FloatArray
from saccade.visual import ObservationKind, VisualResult
from saccade.visual.config import EgomotionSource

SCORES = (
    *("ate_m", "end_m", "closed", "frames_to_close", "entropy", "redetected"),
    *("association_precision", "inside_3sigma"),
)
"""Scores that are stored of each run."""
LOOP_DISTANCE, LOOP_LANDMARKS = 5.0, 3
"""Metres that the robot travelled since it last observed the landmarks that close a loop, and how
many of them it re-identifies in one frame."""
TIMES = 20
"""Times at which the entropy of the pose is stored, evenly over the drive."""


@dataclass(frozen=True)
class GazeRun:
    """One drive with one policy and one seed."""

    world: WorldName
    policy: str
    seed: int
    """Of the world, of all noise, and of what the policy draws."""
    frames: int
    """Largest number of frames."""
    egomotion: EgomotionSource = "camera"
    """What measures the motion."""

    def path(self, out: Path) -> Path:
        """The file of the run; each version of the package has its own."""
        name = f"{self.world}-{self.egomotion}-{self.frames}-{self.policy}-{self.seed}.json"
        return out / "runs" / saccade.__version__ / name

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
        return read_run(path, run.identity, SCORES, {"entropy_over_time": TIMES})
    drive, result = run_in_world(run.world, run.policy, run.seed, run.frames, run.egomotion)
    row = run.identity | score(drive, result)
    write_run(path, row)
    return row


def score(drive: Drive, result: VisualResult) -> dict[str, Any]:
    """The scores of a mapped drive whose truth is known."""
    summary = summarize_drive(drive, result)
    observed = result.observations
    again = observed.landmark[observed.kind == ObservationKind.REIDENTIFIED]
    closed = first_closure(result)
    entropy = pose_entropy(result)
    at = np.linspace(0, len(entropy) - 1, TIMES).round().astype(np.int64)
    names = ("ate_m", "end_m", "association_precision", "inside_3sigma", "ms_per_frame")
    return {
        **{name: summary[name] for name in names},
        "closed": float(closed is not None),
        "frames_to_close": closed,
        "entropy": float(entropy.mean()),
        "entropy_over_time": entropy[at].tolist(),
        "redetected": len(np.unique(again)),
    }


def pose_entropy(result: VisualResult) -> FloatArray:
    """(n - 1,) entropy of the pose after each frame but the first, in nats (meters, radians)."""
    covariance = result.trajectory.covariance
    assert covariance is not None
    determinant = np.linalg.slogdet(2 * np.pi * np.e * (covariance[1:] + 1e-12 * np.eye(3)))[1]
    return np.asarray(determinant / 2)


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
