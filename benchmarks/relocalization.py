"""Relocalization: starts anywhere in a map that an earlier run made (docs/measured.md).

    uv run python benchmarks/relocalization.py [--starts 60] [--log LOG ...]

The map is that of a run with known labels; the scans are those of another run, without them. A
start is correct within three standard deviations or 0.3 m of the true pose, and 0.15 rad. It ends
after five scans, or when a hypothesis has a probability over .99 ("sure"). A recorded log is run
without labels; its starts are poses with eight or more observations, then those with fewer, and
right where the filter was.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from measuring import ROBOT, arguments, without_labels
from saccade import datasets, slam
from saccade.evaluation.trajectory import umeyama
from saccade.plane import rotated, to_points
from saccade.simulation import WorldConfig, simulate_world
from saccade.types import FloatArray, LandmarkLog, LandmarkMap

WORLDS = {
    "robot": replace(ROBOT, steps=800),
    "coarse": replace(ROBOT, steps=800, range_percent=10, bearing_sigma_deg=5, odometry_percent=3),
    "park": WorldConfig(
        course_length=500,
        curvature_amplitude=1.5,
        landmarks=150,
        landmark_spread=25,
        steps=2500,
        step_length=0.5,
        range_limits=(1, 30),
        range_percent=1,
        range_sigma=0.1,
        bearing_sigma_deg=1,
    ),
    "dense": WorldConfig(
        course_length=100,
        landmarks=300,
        landmark_spread=8,
        steps=1200,
        range_limits=(0.5, 8.0),
    ),
}
SURE = 0.99
NEAREST = 12
"""Landmarks around a true pose by which it is brought into the frame of the map; also the poses
before and after it of which they are."""


def in_map(
    pose: FloatArray, truth: FloatArray, mapped: FloatArray, count: int = NEAREST
) -> FloatArray:
    """A pose (3,) in the frame of the map, aligned by the nearest of the points (n, 2) `truth`."""
    near = np.argsort(np.hypot(*(truth - pose[:2]).T))[:count]
    fit = umeyama(truth[near], mapped[near])
    turn = np.arctan2(fit.rotation[1, 0], fit.rotation[0, 0])
    return np.append(fit(pose[None, :2])[0], slam.wrap(pose[2] + turn))


def localize(
    log: LandmarkLog, first: int, landmarks: LandmarkMap
) -> tuple[slam.PoseHypotheses, int, int]:
    """Hypotheses after at most five scans from a pose on, the pose of the last, and the scans."""
    search, used = slam.Relocalizer(landmarks.xy, landmarks.covariance), 0
    for step in range(first, len(log.time)):
        scan = log.observation_pose == step
        if scan.any():
            used += 1
            found = search.add(log.observation[scan], log.observation_covariance[scan])
            if used == 5 or (len(found) and found.probability[0] > SURE):
                break
        search.predict(log.control[step], log.control_covariance[step])
    return found, step, used


def is_right(error: FloatArray, covariance: FloatArray) -> bool:
    """Whether the error of a pose (3,) is within the noise."""
    sigma = np.sqrt(np.trace(covariance[:2, :2]))
    return bool(np.hypot(*error[:2]) < max(0.3, 3 * sigma)) and abs(slam.wrap(error[2])) < 0.15


def report(
    name: str,
    log: LandmarkLog,
    starts: Iterable[int],
    landmarks: LandmarkMap,
    reference: Callable[[int], tuple[FloatArray, FloatArray]],
) -> None:
    """Print a row: starts at poses of a log; `reference` has a right pose and its covariance."""
    rows, begin = [], time.perf_counter()
    for first in starts:
        found, step, used = localize(log, int(first), landmarks)
        right = sure = False
        if len(found):
            pose, covariance = reference(step)
            right = is_right(found.pose[0] - pose, found.covariance[0] + covariance)
            sure = found.probability[0] > SURE
        rows.append((right, sure, sure and not right, used))
    correct, sure, wrong, scans = np.sum(rows, 0)
    print(
        f"{name[:20]:20}{len(rows):6}{correct:9}{sure:6}{wrong:16}{scans / max(len(rows), 1):7.1f}"
        f"{(time.perf_counter() - begin) / max(scans, 1):14.3f}",
        flush=True,
    )


def run_recorded(path: Path, starts: int) -> None:
    """Starts in the map of a recorded log.

    The right pose is that of the filter, moved as the landmarks observed about then have moved
    until the end.
    """
    log = datasets.load("auto", path)
    result = slam.run(log)
    trajectory = result.trajectory

    def reference(step: int) -> tuple[FloatArray, FloatArray]:
        used = (abs(log.observation_pose - step) <= NEAREST) & (result.association >= 0)
        pose = trajectory.pose[log.observation_pose[used]]  # (n, 3)
        points = pose[:, :2] + rotated(to_points(log.observation[used]), pose[:, 2])
        mapped = result.map.xy[result.association[used]]
        right = in_map(trajectory.pose[step], points, mapped, len(points))
        return right, trajectory.covariance[step]

    count = np.bincount(log.observation_pose, minlength=len(log.time))
    poses = np.flatnonzero(count[:-50])
    for name, many in ((path.name, True), (f"{path.name[:12]}, under 8", False)):
        among = poses[(count[poses] >= 8) == many]
        chosen = np.random.default_rng(0).choice(among, min(starts, len(among)), replace=False)
        print(f"{len(among)} of {len(poses)} poses with observations:")
        report(name, without_labels(log), chosen, result.map, reference)


def main() -> None:
    given = arguments(__doc__, starts=60, log={"nargs": "+", "type": Path, "default": []})
    print("world               starts  correct  sure  sure and wrong  scans  seconds a scan")
    for path in given.log:
        run_recorded(path, given.starts)
    for name, world in WORLDS.items() if not given.log else ():
        log, other = simulate_world(world, 1), simulate_world(world, 77)
        mapped = slam.run(log, slam.EkfConfig(association="known")).map
        truth = log.landmark_truth.xy[np.searchsorted(log.landmark_truth.id, mapped.id)]

        def reference(
            step: int,
            other: LandmarkLog = other,
            truth: FloatArray = truth,
            mapped: LandmarkMap = mapped,
        ) -> tuple[FloatArray, FloatArray]:
            return in_map(other.truth.pose[step], truth, mapped.xy), np.zeros((3, 3))

        chosen = np.random.default_rng(0).choice(len(other.time) - 10, given.starts, replace=False)
        report(name, other, chosen, mapped, reference)


if __name__ == "__main__":
    main()
