"""Drives with each gaze policy, scored, and stored so that the study can be resumed."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import tau
from pathlib import Path
from typing import Any, Literal

import numpy as np

import saccade
from saccade import visual
from saccade.errors import require
from saccade.evaluation.drives import summarize_drive
from saccade.evaluation.gaze_landmarks import (
    COURSES,
    FIELD_OF_VIEW,
    drive_by_landmarks,
    landmark_world,
)
from saccade.evaluation.stored_runs import read_run, write_run
from saccade.frames import Drive
from saccade.gaze import POLICIES, Gazer, Policy
from saccade.simulation import DriveConfig, PanCamera, simulate_drive
from saccade.slam import Recorder
from saccade.visual import LandmarkObservations, ObservationKind, VisualConfig, VisualResult
from saccade.visual.config import EGOMOTIONS, EgomotionSource
from saccade.visual.gaze_control import GazeControl
from saccade.visual.second_camera import measure_odometry

PAN_DRIVE = DriveConfig(size=(7.0, 5.5), image_size=(240, 180), field_of_view=50.0)
"""A stereo camera that pans; the ring is smaller than by default."""
SETTINGS = VisualConfig(recover=False)
"""Nobody moves the robot; before a blank wall the test whether somebody did sometimes fails."""
SECOND_FIELD_OF_VIEW = 70.0
"""Degrees of the second, fixed camera."""
LAPS = {"ring": 2, "crossing": 1, "rooms": 1}
"""Of each drive with images; after each the robot is where it began."""
Level = Literal["landmarks", "images"]
LEVELS: dict[str, tuple[str, ...]] = {"landmarks": tuple(COURSES), "images": tuple(LAPS)}
"""Worlds of each level."""
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
    """Of a drive with images."""

    def __post_init__(self) -> None:
        require(self.level in LEVELS, "level", f"one of {', '.join(LEVELS)}", self.level)
        require(self.map in ("new", "known"), "map", "new or known", self.map)
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


def result_of(run: GazeRun, out: Path) -> dict[str, Any]:
    """The scores of a run, read from its file or computed."""
    path, names = run.path(out), {"world": run.world, "policy": run.policy, "seed": run.seed}
    if path.exists():
        return read_run(path, names, SCORES)
    row = names | score(run)
    write_run(path, row)
    return row


def score(run: GazeRun) -> dict[str, Any]:
    """The scores of a drive."""
    policy: Any = run.policy
    if policy not in POLICIES:
        pan = float(np.radians(float(policy)))

        def policy(_: Gazer) -> float:
            return pan

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


def gaze_drive(
    config: DriveConfig,
    policy: str | Policy,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    recorder: Recorder | None = None,
    egomotion: EgomotionSource = "camera",
) -> tuple[Drive, VisualResult]:
    """Map a simulated drive whose camera is turned by a policy.

    Args:
        config: of the drive.
        policy: see `saccade.gaze.Gazer`.
        seed: of the world, of all noise, and of what the policy draws.
        progress: called with the number of frames done and of all frames.
        recorder: takes snapshots of the map while it grows.
        egomotion: what measures the motion.

    Returns:
        The drive, whose frames can now be loaded in any order, and its result.
    """
    pan = PanCamera(seed=seed)
    drive = simulate_drive(config, seed, pan)
    if egomotion == "second-camera":
        second = simulate_drive(replace(config, field_of_view=SECOND_FIELD_OF_VIEW), seed)
        drive = measure_odometry(drive, second, SETTINGS)
    control = GazeControl(policy, drive.camera, pan.limits, pan.turn_to, seed)
    settings = replace(SETTINGS, egomotion=egomotion)
    return drive, visual.run(drive, settings, progress, recorder=recorder, gaze=control)


def closes_loop(observed: LandmarkObservations, frames: int) -> bool:
    """Whether `LOOP_LANDMARKS` are re-identified at least half a drive after they were new."""
    _, first, index = np.unique(observed.landmark, return_index=True, return_inverse=True)
    age = observed.frame - observed.frame[first][index]
    again = (observed.kind == ObservationKind.REIDENTIFIED) & (age >= frames / 2)
    return len(np.unique(observed.landmark[again])) >= LOOP_LANDMARKS
