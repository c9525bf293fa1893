"""Merging the maps of two simulated runs, without names: correctness and consistency.

    uv run python benchmarks/merging.py [--pairs 20]      (docs/map-files.md)

Each map is of the whole course or of a part of it, in the frame of its first pose. For each world:
merges that were refused, pairs of landmarks that are not the same, the mean NEES of the landmarks
of the merged map (2 if it is consistent) and of the transform (3), and the RMSE in metres of the
landmarks of the first map, after the merge and before.
"""

import copy
from dataclasses import replace

import numpy as np

from measuring import ROBOT, arguments
from saccade import slam
from saccade.errors import LogError
from saccade.simulation import WorldConfig, simulate_world
from saccade.slam.consistency import normalized_squared
from saccade.types import LandmarkLog

WORLDS = {"60 landmarks": ROBOT, "loop": WorldConfig.loop()}
PARTS = {"half in common": ((0.0, 0.6), (0.3, 0.9)), "a third": ((0.0, 0.5), (0.35, 0.85))}
"""Laps in which the first and the second map are made."""


def part(log: LandmarkLog, first: int, last: int) -> LandmarkLog:
    """The poses `first` to `last` of a log, in the frame of the first."""
    k = (log.observation_pose >= first) & (log.observation_pose <= last)
    return replace(
        log,
        start=np.zeros(3),
        time=log.time[first : last + 1],
        control=log.control[first:last],
        control_covariance=log.control_covariance[first:last],
        observation_pose=log.observation_pose[k] - first,
        observation=log.observation[k],
        observation_covariance=log.observation_covariance[k],
        landmark=log.landmark[k],
        truth=None,
    )


def measure(
    logs: list[LandmarkLog], parts: tuple[tuple[int, int], tuple[int, int]]
) -> tuple[float, ...] | None:
    """Wrong pairs, pairs, two NEES and two RMSE of one merge; None if it was refused."""
    maps, unnamed = [], []
    for log, (first, last) in zip(logs, parts, strict=True):
        log = part(log, first, last)
        maps.append(slam.slam_for(log))
        slam.run(log, initial=maps[-1])
        unnamed.append(copy.deepcopy(maps[-1]))
        unnamed[-1].landmarks.labels = {}
    try:
        merged = slam.merge_maps(*unnamed)
    except LogError:
        return None
    names = [each.map.label for each in maps]
    common = [np.searchsorted(each.map.id, merged.common[:, i]) for i, each in enumerate(maps)]
    same = names[0][common[0]] == names[1][common[1]]
    new = np.setdiff1d(np.arange(len(names[1])), common[1])
    truth = logs[0].landmark_truth
    rows = np.searchsorted(truth.id, np.concatenate([names[0], names[1][new]]))
    start = logs[0].truth.pose[parts[0][0]]
    c, s = np.cos(start[2]), np.sin(start[2])
    to_map = np.array([[c, -s], [s, c]])
    true = (truth.xy[rows] - start[:2]) @ to_map
    error, C = merged.slam.filter.landmarks - true, merged.slam.filter.landmark_covariances
    nees = normalized_squared(error, C)
    difference = logs[1].truth.pose[parts[1][0]] - start
    wrong = merged.transform - np.append(difference[:2] @ to_map, difference[2])
    wrong[2] = slam.wrap(wrong[2])
    before = maps[0].map.xy - true[: len(names[0])]
    rmse = [np.sqrt(np.square(e).sum(1).mean()) for e in (error[: len(names[0])], before)]
    transform_nees = normalized_squared(wrong, merged.covariance)
    return (~same).sum(), len(same), nees.mean(), transform_nees, *rmse


def main() -> None:
    count = arguments(__doc__, pairs=20).pairs
    for name, world in WORLDS.items():
        lap, whole = world.course_length / world.step_length, (0, world.steps)
        places = {"whole course": (whole, whole)}
        for label, laps in PARTS.items():
            places[label] = tuple((int(a * lap), int(b * lap)) for a, b in laps)
        for label, parts in places.items():
            rows = []
            for seed in range(1, count + 1):
                logs = [simulate_world(world, seed), simulate_world(world, seed + 100)]
                rows.append(measure(logs, parts))
            done = np.array([row for row in rows if row is not None])
            nees = done[:, 2:4].mean(0).round(2)
            print(
                f"{name}, {label}: refused {count - len(done)}, wrong {int(done[:, 0].sum())} of "
                f"{int(done[:, 1].sum())}; NEES of landmarks {nees[0]}, of transform {nees[1]}; "
                f"RMSE {done[:, 4].mean():.3f} m, before {done[:, 5].mean():.3f} m",
                flush=True,
            )


if __name__ == "__main__":
    main()
