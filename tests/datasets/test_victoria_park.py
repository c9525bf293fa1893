"""Victoria Park as GTSAM distributes it, and cityTrees: real sizes, outside answers."""

from importlib.resources import files

import gtsam
import numpy as np
import pytest

from saccade import slam
from saccade.datasets import load
from saccade.slam import inverse_observe
from support.alignment import align
from support.nightly import nightly

UNWEIGHTED = slam.EkfConfig(huber=np.inf, association="known", estimate_systematic_errors=False)
"""The loss of GTSAM's graphs here is the plain one."""


def _smoothed_map(graph, pose_keys, result):
    """GTSAM's map from a graph without a fixed pose, begun at the filter's estimate."""
    values = gtsam.Values()
    for key, pose in zip(pose_keys, result.trajectory.pose, strict=True):
        values.insert(key, gtsam.Pose2(*pose))
    landmark_keys = [gtsam.symbol("l", i) for i in result.map.id.tolist()]
    for key, xy in zip(landmark_keys, result.map.xy, strict=True):
        values.insert(key, xy)
    fixed = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
    graph.add(gtsam.PriorFactorPose2(pose_keys[0], gtsam.Pose2(0, 0, 0), fixed))
    best = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return np.array([best.atPoint2(key) for key in landmark_keys])


def _median_distance(ours, theirs):
    apart = np.hypot(*(align(ours, theirs) - theirs).T)
    print(f"\nlandmarks from GTSAM's: median {np.median(apart):.3f} m, largest {apart.max():.3f} m")
    return np.median(apart)


@pytest.mark.parametrize(("lines", "landmarks"), [(2500, None), *nightly((None, 151))])
def test_map_agrees_with_gtsams_own_reading_of_the_file(lines, landmarks, tmp_path):
    whole = (files("saccade") / "data" / "victoria_park.txt").read_text().splitlines()[:lines]
    (tmp_path / "log.txt").write_text("\n".join(whole) + "\n")
    log = load("isam", tmp_path / "log.txt")
    result = slam.run(log, UNWEIGHTED)
    graph, _ = gtsam.load2D(str(tmp_path / "log.txt"))
    smoothed = _smoothed_map(graph, log.time.astype(int).tolist(), result)
    read = {line.split()[2] for line in whole if line.startswith("LANDMARK")}
    assert len(result.map) == len(read)
    assert landmarks in (None, len(read))
    assert _median_distance(result.map.xy, smoothed) < 0.65


@pytest.mark.shared
def test_city_of_trees_is_found_where_it_was_made(shared):
    folder = shared / "data/logs/citytrees"
    log = load("auto", folder / "cityTrees10000.txt")
    truth = slam.dead_reckon(load("auto", folder / "cityTrees10000_groundtruth.txt")).pose
    result = slam.run(log)
    used = np.flatnonzero(result.association >= 0)
    first = used[np.unique(result.association[used], return_index=True)[1]]
    exact = load("isam", folder / "cityTrees10000_groundtruth.txt").observation
    from_pose = truth[log.observation_pose[first]]
    trees = np.array(
        [inverse_observe(p, z)[0] for p, z in zip(from_pose, exact[first], strict=True)]
    )
    apart = np.hypot(*(align(result.map.xy, trees) - trees).T)
    assert len(result.map) == 100
    assert np.sqrt((apart**2).mean()) < 0.1
    path = result.trajectory.pose[:, :2]
    off = np.hypot(*(align(path, truth[:, :2]) - truth[:, :2]).T)
    assert np.sqrt((off**2).mean()) < 1.5
    low, high = result.consistency.band  # at two standard deviations; within three
    assert abs(result.consistency.mean - 2) < 1.5 * (high - low) / 2
