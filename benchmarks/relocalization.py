"""Relocalization: starts anywhere in a map that an earlier run of a simulated world made.

    uv run python benchmarks/relocalization.py [--starts 60] [--log LOG ...]

The map is that of a run with known identities; the scans are those of another run, without them. A
start is correct within three standard deviations or 0.3 m of the true pose, and 0.15 rad. It ends
after five scans, or when a hypothesis has a probability over .99 ("sure"). A recorded log is run
without names; its starts are poses with eight or more observations, then those with fewer, and
right where the filter was.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from saccade import datasets, slam
from saccade.simulation import WorldConfig, simulate_world
from saccade.types import FloatArray, IntArray, LandmarkLog, LandmarkMap

ROBOT = WorldConfig(
    course_length=60, landmarks=60, landmark_spread=6, steps=800, range_limits=(0.5, 8.0)
)
WORLDS = {
    "robot": ROBOT,
    "coarse": replace(ROBOT, range_percent=10, bearing_sigma_deg=5, odometry_percent=3),
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
    pose: FloatArray, truth: FloatArray, mapped: FloatArray, most: int = NEAREST
) -> FloatArray:
    """A pose in the frame of the map, aligned by the nearest of the points (n, 2) `truth`."""
    near = np.argsort(np.hypot(*(truth - pose[:2]).T))[:most]
    a, b = truth[near] - truth[near].mean(0), mapped[near] - mapped[near].mean(0)
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    xy = rotation @ (pose[:2] - truth[near].mean(0)) + mapped[near].mean(0)
    return np.append(xy, slam.wrap(pose[2] + turn))


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


def run_recorded(path: Path, starts: int) -> None:
    """Starts in the map of a recorded log."""
    log = datasets.load("auto", path)
    result = slam.run(log)
    log = replace(log, landmark=np.full_like(log.landmark, -1))
    count = np.bincount(log.observation_pose, minlength=len(log.time))
    poses = np.flatnonzero(count[:-50])
    for name, many in ((path.name, True), (f"{path.name[:12]}, under 8", False)):
        among = poses[(count[poses] >= 8) == many]
        chosen = np.random.default_rng(0).choice(among, min(starts, len(among)), replace=False)
        print(f"{len(among)} of {len(poses)} poses with observations:")
        run_starts(name, log, result, chosen)


def run_starts(name: str, log: LandmarkLog, result: slam.SlamResult, chosen: IntArray) -> None:
    """Starts at some poses (m,) of a recorded log, in its last map.

    The right pose is that of the filter, moved as the landmarks observed about then have moved
    until the end.
    """
    correct = sure = wrong = scans = 0
    start = time.perf_counter()
    for first in chosen:
        found, step, used = localize(log, int(first), result.map)
        scans += used
        if len(found) == 0:
            continue
        used_then = (abs(log.observation_pose - step) <= NEAREST) & (result.association >= 0)
        pose = result.trajectory.pose[log.observation_pose[used_then]]  # (n, 3)
        z, mapped = log.observation[used_then], result.map.xy[result.association[used_then]]
        angle = pose[:, 2] + z[:, 1]
        points = pose[:, :2] + z[:, :1] * np.stack([np.cos(angle), np.sin(angle)], 1)
        error = found.pose[0] - in_map(result.trajectory.pose[step], points, mapped, len(points))
        right = is_right(error, found.covariance[0] + result.trajectory.covariance[step])
        correct += right
        sure += found.probability[0] > SURE
        wrong += not right and found.probability[0] > SURE
    report(name, len(chosen), correct, sure, wrong, scans, time.perf_counter() - start)


def is_right(error: FloatArray, covariance: FloatArray) -> bool:
    """Whether the error of a pose (3,) is within the noise."""
    sigma = np.sqrt(np.trace(covariance[:2, :2]))
    return bool(np.hypot(*error[:2]) < max(0.3, 3 * sigma)) and abs(slam.wrap(error[2])) < 0.15


def report(
    name: str, starts: int, correct: int, sure: int, wrong: int, scans: int, seconds: float
) -> None:
    """Print a row."""
    print(
        f"{name[:20]:20}{starts:6}{correct:9}{sure:6}{wrong:16}{scans / max(starts, 1):7.1f}"
        f"{seconds / max(scans, 1):14.3f}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=60)
    parser.add_argument("--log", type=Path, nargs="+", default=[])
    options = parser.parse_args()
    starts = options.starts
    print("world               starts  correct  sure  sure and wrong  scans  seconds a scan")
    for path in options.log:
        run_recorded(path, starts)
    if options.log:
        return
    for name, world in WORLDS.items():
        log, other = simulate_world(world, 1), simulate_world(world, 77)
        mapped = slam.run(log, slam.EkfConfig(association="known")).map
        rows = np.searchsorted(log.landmark_truth.id, mapped.id)
        truth = log.landmark_truth.xy[rows]
        correct = sure = wrong = scans = 0
        chosen = np.random.default_rng(0).choice(len(other.time) - 10, starts, replace=False)
        begin = time.perf_counter()
        for first in chosen:
            found, step, used = localize(other, int(first), mapped)
            scans += used
            if len(found) == 0:
                continue
            error = found.pose[0] - in_map(other.truth.pose[step], truth, mapped.xy)
            right = is_right(error, found.covariance[0])
            correct += right
            sure += found.probability[0] > SURE
            wrong += not right and found.probability[0] > SURE
        report(name, starts, correct, sure, wrong, scans, time.perf_counter() - begin)


if __name__ == "__main__":
    main()
