"""What a saved map is worth to another run: localizing in it, mapping on, and mapping anew.

    uv run python benchmarks/saved_maps.py [--mrclam mrclam6.npz] [--seeds 20]   (docs/map-files.md)

Simulated worlds: the map is that of one run, the robot that of another one; the start is the true
one in the frame of the map. "exact" takes the landmarks of the map as exact. Of MRCLAM, robots 2 to
5 drive in the map of robot 1. Position RMSE in meters, and the mean NEES of the pose (3 if it is
consistent) from the first hundred poses on.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from measuring import ROBOT, arguments
from saccade import datasets, slam
from saccade.evaluation.trajectory import point_rmse
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import pose_nees
from saccade.types import LandmarkLog

WORLDS = {"loop": WorldConfig.loop(), "slippery": WorldConfig.slippery(), "robot": ROBOT}


def mapped(log: LandmarkLog) -> slam.Slam:
    """The `Slam` that has mapped a log."""
    robot = slam.slam_for(log)
    slam.run(log, initial=robot)
    return robot


def exact(file: Path, log: LandmarkLog) -> slam.Slam:
    """The map with landmarks that have no uncertainty."""
    robot = slam.Slam.load(file, "localize", start=log.start)
    ekf, r = robot.filter, len(robot.filter.robot_state)
    P = ekf.covariance
    P[r:, r:] = 1e-8 * np.eye(len(P) - r)
    ekf.set_gaussian(ekf.state, P, ekf.ids)
    return robot


def scores(log: LandmarkLog, file: Path) -> Iterator[tuple[str, float, float]]:
    """RMSE without alignment and NEES of the four ways to drive a log."""
    ways = {
        "anew": slam.slam_for(log),
        "localize": slam.Slam.load(
            file, "localize", start=log.start, odometry_bias=log.odometry_bias
        ),
        "exact": exact(file, log),
    }
    for name, robot in ways.items():
        estimate = slam.run(log, initial=robot).trajectory
        nees = np.nan
        if len(log.truth) == len(estimate):
            nees = float(np.nanmean(pose_nees(estimate, log.truth, "invariant")[100:]))
        yield (
            name,
            point_rmse(estimate.pose[:, :2], log.truth.at(log.time)[:, :2], aligned=False),
            nees,
        )


def show(title: str, rows: list[list[tuple[str, float, float]]]) -> None:
    """Print the means over runs."""
    columns = [
        f"{row[0][0]} {np.mean([each[1] for each in row]):.3f} m, "
        f"NEES {np.mean([each[2] for each in row]):.2f}"
        for row in zip(*rows, strict=True)
    ]
    print(f"{title:18}", "; ".join(columns), flush=True)


def main() -> None:
    given = arguments(__doc__, mrclam={"type": Path, "default": None}, seeds=20)
    file = Path(tempfile.mkdtemp()) / "map.npz"
    for name, world in WORLDS.items():
        rows = []
        for seed in range(given.seeds):
            mapped(simulate_world(world, seed)).save(file)
            rows.append([*scores(simulate_world(world, seed + 500), file)])
        show(name, rows)
    if given.mrclam is None:
        return
    logs = [datasets.load("mrclam", given.mrclam, robot=robot) for robot in range(1, 6)]
    robots = [mapped(log) for log in logs]
    robots[0].save(file)
    for number, log in enumerate(logs[1:], 2):
        show(f"MRCLAM, robot {number}", [[*scores(log, file)]])


if __name__ == "__main__":
    main()
