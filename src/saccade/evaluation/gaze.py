"""Gaze policies: drives with each, scored, stored to be resumed, and compared."""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import NoneType
from typing import Any, Literal, TypeVar

import cv2
import numpy as np

import saccade
from saccade import visual
from saccade.errors import ConfigError, Settings, require
from saccade.evaluation.intervals import mean_interval
from saccade.evaluation.runs import score_drive
from saccade.frames import Drive
from saccade.gaze import POLICIES, Gazer, Policy
from saccade.io.files import atomic_write, read_text, reason_of, written_at_once
from saccade.plane import steps_between
from saccade.simulation import DriveConfig, PanCamera, WorldConfig, simulate_drive, simulate_world
from saccade.simulation.drive import ENCODER_SIGMA
from saccade.slam import EkfConfig, Recorder, Slam
from saccade.slam.models import observe, wrap
from saccade.types import LandmarkLog, Trajectory
from saccade.visual import VisualConfig, VisualResult, measure_odometry
from saccade.visual.config import EgomotionSource
from saccade.visual.gaze_control import GazeControl

Item = TypeVar("Item")
Result = TypeVar("Result")

SETTINGS = VisualConfig(recover=False)
"""Nobody moves the robot; before a blank wall the test whether somebody did sometimes fails."""
SECOND_FIELD_OF_VIEW = 70.0
"""Degrees of the second, fixed camera."""


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


FIELD_OF_VIEW, REACH, RATE, PERIOD = float(np.radians(50)), 8.0, float(np.radians(120)), 0.2
"""Of the camera in radians, metres and radians per second; and seconds from scan to scan."""
SPEED, COURSE_LAPS = 1.0, 2
"""Of the robot in metres per second."""
KNOWN_SIGMA = 0.02
"""Standard deviation of the landmarks of a map that is known, in metres."""
COURSES = {  # metres, curvature, seed of the landmarks
    "pond": (62.0, 0.0, 1),
    "clover": (80.0, 0.9, 2),
    "island": (96.0, 1.4, 3),
    "park": (114.0, 1.0, 4),
    "yard": (70.0, 0.5, 5),
    "campus": (105.0, 1.2, 6),
}


def landmark_world(name: str) -> WorldConfig:
    """An uneven world of `COURSES`: landmarks stand in groups, and wheels err systematically."""
    length, curvature, layout = COURSES[name]
    return WorldConfig(
        course_length=length,
        curvature_amplitude=curvature,
        steps=round(COURSE_LAPS * length / SPEED / PERIOD),
        step_length=SPEED * PERIOD,
        step_time=PERIOD,
        landmarks=40,
        group_size=4,
        layout=layout,
        landmark_spread=6.0,
        range_limits=(0.3, REACH),
        range_percent=0.0,
        range_sigma=0.1,
        bearing_sigma=1.0,
        odometry_percent=1.0,
        scale_percent=3.0,
        heading_drift=1.5,
    )


def drive_by_landmarks(
    world: WorldConfig,
    policy: str | Policy,
    seed: int,
    known: bool = False,
    fov: float = FIELD_OF_VIEW,
) -> dict[str, float]:
    """Drive through a world; the camera sees what lies in the view that a policy chooses.

    Args:
        world: its scans see in all directions.
        policy: see `Gazer`.
        seed: of all noise, which is equal for all policies, and of what the policy draws.
        known: whether the map is known, else it is made.
        fov: of the camera in radians.

    Returns:
        Root mean squared error of the position in metres, fraction of the positions inside their
        99.7 % ellipse, and whether landmarks of the first lap were seen again in the second.
    """
    log = simulate_world(world, seed)
    assert log.truth is not None
    slam = _robot(log, known)
    gazer = Gazer(
        slam,
        fov,
        REACH,
        rate=RATE,
        period=PERIOD,
        policy=policy,
        seed=seed,
        pan_sigma=ENCODER_SIGMA,
    )
    encoder = ENCODER_SIGMA * np.random.default_rng([seed, 1]).standard_normal(len(log.time))
    steps = steps_between(log.truth.pose)  # a robot that follows a path knows those to come
    results = []
    pan, closed, first = 0.0, False, dict[int, int]()
    scans = np.searchsorted(log.observation_pose, np.arange(len(log.time) + 1))
    for i, time in enumerate(log.time.tolist()):
        rows = np.arange(scans[i], scans[i + 1])
        rows = rows[np.abs(wrap(log.observation[rows, 1] - pan)) <= fov / 2]
        names = log.landmark[rows]
        moved = (log.control[i - 1], log.control_covariance[i - 1]) if i else (None, None)
        z = log.observation[rows] + np.array([0.0, encoder[i]])
        scan = z, gazer.add_pan_error(log.observation_covariance[rows]), names
        results.append(slam.step(time, *moved, *(scan if len(rows) else ())))
        gazer.observed(pan + encoder[i], names)
        for name in names.tolist():
            closed |= i - first.setdefault(name, i) > len(log.time) / COURSE_LAPS / 2
        pan = gazer.next(steps[i:] if i < len(steps) else None).pan
    poses, covariances = zip(*((each.pose, each.covariance) for each in results), strict=True)
    estimate = Trajectory(log.time, np.array(poses), np.array(covariances))
    error = score_drive(estimate, log.truth)
    inside = error.inside_3sigma
    return {"ate_m": error.ate_unaligned_m, "closed": closed, "inside_3sigma": inside}


def _robot(log: LandmarkLog, known: bool) -> Slam:
    """At the start of a log, with all landmarks in its map if it is known."""
    config = EkfConfig(association="known", recover=False)
    slam = Slam(config, start=log.start, odometry_bias=log.odometry_bias)
    if known:
        assert log.landmark_truth is not None
        z = observe(log.start, log.landmark_truth.xy)[0]
        R = KNOWN_SIGMA**2 * np.stack([np.ones(len(z)), z[:, 0] ** -2.0], 1)[:, None] * np.eye(2)
        slam.step(float(log.time[0]), z=z, R=R, names=log.landmark_truth.id)
        slam.mode = "localize"
    return slam


SCORES = "ate_m", "closed", "inside_3sigma"
"""Scores that are stored of each run."""


@dataclass(frozen=True)
class GazeRun(Settings):
    """One drive with one policy and one seed.

    Raises:
        ConfigError: a name that is none.
    """

    world: str
    """A name of `COURSES`."""
    policy: str
    """A name of `POLICIES`."""
    seed: int
    """Of the world's noise, and of what the policy draws."""
    map: Literal["new", "known"] = "new"
    """Whether the map is made, or known before."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.world in COURSES, "world", f"one of {', '.join(COURSES)}", self.world)
        expected = f"one of {', '.join(POLICIES)}"
        require(self.policy in POLICIES, "policy", expected, self.policy)

    def path(self, out: Path) -> Path:
        """The file of the run; each version of the package has its own."""
        name = "-".join(str(value) for value in asdict(self).values())
        return out / "runs" / saccade.__version__ / f"{name}.json"


def result_of(run: GazeRun, out: Path) -> dict[str, Any]:
    """The scores of a run, read from its file or computed."""
    path, names = run.path(out), {"world": run.world, "policy": run.policy, "seed": run.seed}
    if path.exists():
        return read_run(path, names, SCORES)
    world = landmark_world(run.world)
    row = names | drive_by_landmarks(world, run.policy, run.seed, run.map == "known")
    write_run(path, row)
    return row


def map_in_processes(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    jobs: int = 1,
    progress: Callable[[int, int], object] | None = None,
) -> list[Result]:
    """The result of each item, in their order.

    Args:
        work: what is done with one; it can be pickled.
        items: the items.
        jobs: number of processes; with several, each has a single OpenCV thread.
        progress: called with the items done and their number.
    """
    results: list[Result] = []
    one_thread = partial(cv2.setNumThreads, 1)  # in each child process alone
    with ProcessPoolExecutor(jobs, get_context("spawn"), one_thread) as pool:
        for result in (pool.map if jobs > 1 else map)(work, items):
            results.append(result)
            if progress is not None:
                progress(len(results), len(items))
    return results


def write_run(path: Path, row: dict[str, Any]) -> None:
    """Store a run as JSON, whole or not at all."""
    with written_at_once(), atomic_write(path) as temporary:
        temporary.write_text(json.dumps(row, indent=2) + "\n", encoding="utf-8")


def read_run(path: Path, expected: dict[str, Any], scores: Sequence[str]) -> dict[str, Any]:
    """A stored run, which has to match.

    Args:
        path: its file.
        expected: values that it has.
        scores: names of its numbers, which may be null.

    Raises:
        ConfigError: it cannot be read, or does not match.
    """
    try:
        content: Any = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: cannot be read: {reason_of(error)}; delete it") from error
    row: dict[str, Any] = content if isinstance(content, dict) else {}
    scored = all(isinstance(row.get(name, ""), (float, int, NoneType)) for name in scores)
    if not scored or any(row.get(name) != value for name, value in expected.items()):
        raise ConfigError(f"{path}: expected a run with its scores, found none; delete it")
    return row


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
    table = np.array(
        [
            [[[found[p, w, s][score] for score in SCORES] for s in seeds] for w in worlds]
            for p in policies
        ],
        np.float64,
    )  # (p, w, s, 3)
    log = dict(zip(policies, np.log(table[..., 0]), strict=True))  # (w, s) of each
    rows = []
    for policy, scores in zip(policies, table, strict=True):
        row: dict[str, Any] = {"policy": policy, "ate_m": float(np.exp(np.median(log[policy])))}
        for reference in ("fixed", "sweep"):
            row[f"to_{reference}"] = None
            if reference in policies:
                gain = log[policy] - log[reference]
                low, high = mean_interval(gain.mean(0)[:, None], CONFIDENCE, seed=0)
                row[f"to_{reference}"] = np.exp([gain.mean(), low[0], high[0]]).tolist()
        if "fixed" in policies:
            gain = log[policy] - log["fixed"]
            row["worlds"] = dict(zip(worlds, np.exp(gain.mean(1)).tolist(), strict=True))
            row["worst"] = float(np.exp(gain.max()))
        row["closed"] = int(scores[..., 1].sum())
        row["drives"] = scores[..., 0].size
        row["inside_3sigma"] = float(scores[..., 2].mean())
        rows.append(row)
    return rows
